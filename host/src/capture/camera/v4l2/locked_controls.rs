//! Freezing a camera's automatic controls for a sequence of pictures.

use std::{mem, sync::Arc};

use v4l::Device;

use super::{driver::CameraFault, ioctl};
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

/// Values of `EXPOSURE_AUTO`: with the first, the exposure time and the iris are fixed, with the second the time alone.
const EXPOSURE_MANUAL: i32 = 1;
const EXPOSURE_SHUTTER_PRIORITY: i32 = 2;

/// A quantity that a camera can regulate by itself.
struct AutomaticControl {
    /// Its name in messages.
    name: &'static str,
    /// The control that switches between automatic and manual.
    mode: u32,
    /// The values of `mode` for manual, the best first.
    manual: &'static [i32],
    /// The controls that hold the value. A device has at most one of them.
    values: &'static [u32],
    /// The value that the settings request.
    requested: fn(&CameraSettings) -> Option<i32>,
}

const AUTOMATIC_CONTROLS: [AutomaticControl; 4] = [
    AutomaticControl {
        name: "exposure",
        mode: cid::EXPOSURE_AUTO,
        manual: &[EXPOSURE_MANUAL, EXPOSURE_SHUTTER_PRIORITY],
        // The first is in units of 100 µs; old drivers have the second, in units of their own.
        values: &[cid::EXPOSURE_ABSOLUTE, cid::EXPOSURE],
        requested: |settings| settings.exposure,
    },
    AutomaticControl {
        name: "gain",
        mode: cid::AUTOGAIN,
        manual: &[0],
        values: &[cid::GAIN, cid::ANALOGUE_GAIN],
        requested: |settings| settings.gain,
    },
    AutomaticControl {
        name: "focus",
        mode: cid::FOCUS_AUTO,
        manual: &[0],
        values: &[cid::FOCUS_ABSOLUTE],
        requested: |settings| settings.focus,
    },
    AutomaticControl {
        name: "white balance",
        mode: cid::AUTO_WHITE_BALANCE,
        manual: &[0],
        values: &[cid::WHITE_BALANCE_TEMPERATURE],
        requested: |settings| settings.white_balance,
    },
];

/// The controls that were changed. Dropping it restores them.
pub(super) struct LockedControls {
    device: Arc<Device>,
    /// Their numbers and previous values, in the order of the changes.
    previous: Vec<(u32, i32)>,
    unlocked: Vec<&'static str>,
}

impl LockedControls {
    /// Sets the values that `settings` request. If they ask for it, it also freezes the other automatic controls that can be.
    pub(super) fn lock(device: &Arc<Device>, settings: &CameraSettings) -> Result<LockedControls, CameraFault> {
        let mut locked = LockedControls { device: device.clone(), previous: Vec::new(), unlocked: Vec::new() };
        for control in &AUTOMATIC_CONTROLS {
            let name = control.name;
            match (control.requested)(settings) {
                Some(value) => {
                    let frozen = locked.freeze(control, Some(value));
                    frozen.map_err(|found| CameraFault::Control { control: name, value, found })?;
                }
                None if settings.lock && locked.freeze(control, None).is_err() => locked.unlocked.push(name),
                None => {}
            }
        }
        Ok(locked)
    }

    /// Returns true if nothing was changed.
    pub(super) fn is_empty(&self) -> bool {
        self.previous.is_empty()
    }

    /// The quantities that should be frozen, but that the camera goes on regulating.
    pub(super) fn unlocked(&self) -> &[&'static str] {
        &self.unlocked
    }

    /// Switches a control to manual, at the requested value or at its present one. The error is what was found instead.
    fn freeze(&mut self, control: &AutomaticControl, requested: Option<i32>) -> Result<(), String> {
        let automatic = self.get(control.mode)?.filter(|mode| !control.manual.contains(mode));
        let current = control.values.iter().find_map(|&id| Some((id, self.get(id).ok()??)));
        if let Some(mode) = automatic {
            self.make_manual(control, mode).map_err(|found| format!("no manual mode ({found})"))?;
            // Some cameras jump to another value when they switch to manual. Those that cannot be set stay
            // where they are.
            if let (Some((id, value)), None) = (current, requested) {
                let _ = ioctl::set_control(&self.device, id, value);
            }
        }
        match (current, requested) {
            (Some((id, value)), Some(requested)) => self.change(id, value, requested),
            (None, Some(_)) => Err("no such control".into()),
            (_, None) => Ok(()),
        }
    }

    /// Switches a control from the automatic `mode` to the first of its manual ones that the device has.
    fn make_manual(&mut self, control: &AutomaticControl, mode: i32) -> Result<(), String> {
        let mut switched = Ok(());
        for &manual in control.manual {
            switched = self.change(control.mode, mode, manual);
            if switched.is_ok() {
                break;
            }
        }
        switched
    }

    /// Sets a control that is now at `current`, and checks the result. The error is what was found instead.
    fn change(&mut self, id: u32, current: i32, value: i32) -> Result<(), String> {
        ioctl::set_control(&self.device, id, value).map_err(|error| error.to_string())?;
        self.previous.push((id, current));
        match self.get(id) {
            // Drivers silently choose the nearest value that they have.
            Ok(Some(found)) if found != value => Err(found.to_string()),
            _ => Ok(()),
        }
    }

    /// The value of a control. `None` if the device does not have it.
    fn get(&self, id: u32) -> Result<Option<i32>, String> {
        match ioctl::control(&self.device, id) {
            Ok(value) => Ok(Some(value)),
            Err(error) if matches!(error.raw_os_error(), Some(libc::EINVAL | libc::ENOTTY)) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }
}

impl Drop for LockedControls {
    fn drop(&mut self) {
        // In reverse: a value can only be set while its control is manual.
        for (id, value) in mem::take(&mut self.previous).into_iter().rev() {
            // This fails if the camera is gone, and then there is nothing to restore.
            let _ = ioctl::set_control(&self.device, id, value);
        }
    }
}
