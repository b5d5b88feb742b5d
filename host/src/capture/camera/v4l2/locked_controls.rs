//! Freezing a camera's automatic controls for a sequence of pictures.

use std::{io, mem, sync::Arc};

use v4l::{Control, Device, control::Value};

use super::driver::{self, CameraFault};
use crate::capture::camera::CameraSettings;

/// Control numbers of linux/v4l2-controls.h. The bindings generated in `v4l2-sys` have only what crate `v4l`
/// itself uses.
mod cid {
    const USER_BASE: u32 = 0x0098_0900;
    const CAMERA_BASE: u32 = 0x009a_0900;
    const IMAGE_SOURCE_BASE: u32 = 0x009e_0900;

    pub const AUTO_WHITE_BALANCE: u32 = USER_BASE + 12;
    pub const EXPOSURE: u32 = USER_BASE + 17;
    pub const AUTOGAIN: u32 = USER_BASE + 18;
    pub const GAIN: u32 = USER_BASE + 19;
    pub const WHITE_BALANCE_TEMPERATURE: u32 = USER_BASE + 26;
    pub const EXPOSURE_AUTO: u32 = CAMERA_BASE + 1;
    pub const EXPOSURE_ABSOLUTE: u32 = CAMERA_BASE + 2;
    pub const FOCUS_ABSOLUTE: u32 = CAMERA_BASE + 10;
    pub const FOCUS_AUTO: u32 = CAMERA_BASE + 12;
    pub const ANALOGUE_GAIN: u32 = IMAGE_SOURCE_BASE + 3;
}

/// `V4L2_EXPOSURE_MANUAL`, a value of `EXPOSURE_AUTO`.
const EXPOSURE_MANUAL: i64 = 1;

/// A quantity that a camera can regulate by itself.
struct AutomaticControl {
    /// Its name in messages.
    name: &'static str,
    /// The control that switches between automatic and manual.
    mode: u32,
    /// The value of `mode` for manual.
    manual: fn() -> Value,
    /// The controls that hold the value. A device has at most one of them.
    values: &'static [u32],
    /// The value that the settings request.
    requested: fn(&CameraSettings) -> Option<i32>,
}

const AUTOMATIC_CONTROLS: [AutomaticControl; 4] = [
    AutomaticControl {
        name: "exposure",
        mode: cid::EXPOSURE_AUTO,
        manual: || Value::Integer(EXPOSURE_MANUAL),
        // The first is in units of 100 µs; old drivers have the second, in units of their own.
        values: &[cid::EXPOSURE_ABSOLUTE, cid::EXPOSURE],
        requested: |settings| settings.exposure,
    },
    AutomaticControl {
        name: "gain",
        mode: cid::AUTOGAIN,
        manual: || Value::Boolean(false),
        values: &[cid::GAIN, cid::ANALOGUE_GAIN],
        requested: |settings| settings.gain,
    },
    AutomaticControl {
        name: "focus",
        mode: cid::FOCUS_AUTO,
        manual: || Value::Boolean(false),
        values: &[cid::FOCUS_ABSOLUTE],
        requested: |settings| settings.focus,
    },
    AutomaticControl {
        name: "white balance",
        mode: cid::AUTO_WHITE_BALANCE,
        manual: || Value::Boolean(false),
        values: &[cid::WHITE_BALANCE_TEMPERATURE],
        requested: |settings| settings.white_balance,
    },
];

/// The controls that were changed. Dropping it restores them.
pub(super) struct LockedControls {
    device: Arc<Device>,
    /// Their previous values, in the order of the changes.
    previous: Vec<Control>,
}

impl LockedControls {
    /// Sets the values that `settings` request, and freezes the other automatic controls if they ask for it.
    pub(super) fn lock(device: &Arc<Device>, settings: &CameraSettings) -> Result<LockedControls, CameraFault> {
        let mut locked = LockedControls { device: device.clone(), previous: Vec::new() };
        for control in &AUTOMATIC_CONTROLS {
            let requested = (control.requested)(settings);
            if settings.lock || requested.is_some() {
                locked.freeze(control, requested)?;
            }
        }
        Ok(locked)
    }

    /// Returns true if nothing was changed.
    pub(super) fn is_empty(&self) -> bool {
        self.previous.is_empty()
    }

    /// Switches a control to manual, at the requested value or at its present one.
    fn freeze(&mut self, control: &AutomaticControl, requested: Option<i32>) -> Result<(), CameraFault> {
        let automatic = self.get(control.mode).ok().filter(|mode| mode.value != (control.manual)());
        let value = control.values.iter().find_map(|&id| self.get(id).ok());
        if let Some(mode) = automatic {
            self.change(control, mode, (control.manual)())?;
            // Some cameras jump to another value when they switch to manual. Those that cannot be set stay
            // where they are.
            if let (Some(value), None) = (&value, requested) {
                let _ = self.set(Control { id: value.id, value: copy(&value.value) });
            }
        }
        match (value, requested) {
            (Some(value), Some(requested)) => self.change(control, value, Value::Integer(requested.into())),
            (None, Some(_)) => Err(CameraFault::NoControl { control: control.name }),
            (_, None) => Ok(()),
        }
    }

    /// Sets a control that is now at `current`, and checks the result.
    fn change(&mut self, control: &AutomaticControl, current: Control, value: Value) -> Result<(), CameraFault> {
        let id = current.id;
        self.previous.push(current);
        let refused = |found: String| CameraFault::Control { control: control.name, value: text(&value), found };
        self.set(Control { id, value: copy(&value) }).map_err(|error| refused(error.to_string()))?;
        match self.get(id) {
            // Drivers silently choose the nearest value that they have.
            Ok(found) if found.value != value => Err(refused(text(&found.value))),
            _ => Ok(()),
        }
    }

    fn get(&self, id: u32) -> io::Result<Control> {
        driver::catch_panic(|| self.device.control(id))
    }

    fn set(&self, control: Control) -> io::Result<()> {
        driver::catch_panic(|| self.device.set_control(control))
    }
}

impl Drop for LockedControls {
    fn drop(&mut self) {
        // In reverse: a value can only be set while its control is manual.
        for control in mem::take(&mut self.previous).into_iter().rev() {
            // This fails if the camera is gone, and then there is nothing to restore.
            let _ = self.set(control);
        }
    }
}

/// Copies a value, which is not `Clone`. The controls above are integers and booleans.
fn copy(value: &Value) -> Value {
    match value {
        Value::Integer(number) => Value::Integer(*number),
        Value::Boolean(is_on) => Value::Boolean(*is_on),
        _ => Value::None,
    }
}

fn text(value: &Value) -> String {
    match value {
        Value::Integer(number) => number.to_string(),
        Value::Boolean(is_on) => if *is_on { "on" } else { "off" }.into(),
        other => format!("{other:?}"),
    }
}
