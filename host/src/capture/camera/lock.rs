//! What a camera sets by itself, held still for a sequence of pictures.

use std::{io, mem, sync::Arc};

use v4l::{Control, Device, control::Value};

use super::{Fault, Settings, driver};

/// Something that a camera can set by itself.
struct Knob {
    /// What it is.
    name: &'static str,
    /// The control that gives it to the camera or to us.
    automatic: u32,
    /// The value of that control by which it is ours.
    manual: fn() -> Value,
    /// The controls of its value, of which devices have one.
    values: &'static [u32],
    /// The value asked for.
    wanted: fn(&Settings) -> Option<i32>,
}

/// The controls by their numbers in linux/v4l2-controls.h.
const KNOBS: [Knob; 4] = [
    Knob {
        name: "exposure",
        automatic: 0x009a_0901,
        // V4L2_EXPOSURE_MANUAL
        manual: || Value::Integer(1),
        // In units of 100 µs, and, of old drivers, in their own.
        values: &[0x009a_0902, 0x0098_0911],
        wanted: |settings| settings.exposure,
    },
    Knob {
        name: "gain",
        automatic: 0x0098_0912,
        manual: || Value::Boolean(false),
        // Of the camera, and of the sensor alone.
        values: &[0x0098_0913, 0x009e_0903],
        wanted: |settings| settings.gain,
    },
    Knob {
        name: "focus",
        automatic: 0x009a_090c,
        manual: || Value::Boolean(false),
        values: &[0x009a_090a],
        wanted: |settings| settings.focus,
    },
    Knob {
        name: "white balance",
        automatic: 0x0098_090c,
        manual: || Value::Boolean(false),
        values: &[0x0098_091a],
        wanted: |settings| settings.white_balance,
    },
];

/// Controls that were changed. They are set back when it is dropped.
pub(super) struct Lock {
    device: Arc<Device>,
    /// What they were, in the order in which they were changed.
    before: Vec<Control>,
}

impl Lock {
    /// Sets what `settings` ask for, and holds still what they want locked.
    pub(super) fn set(device: &Arc<Device>, settings: &Settings) -> Result<Lock, Fault> {
        let mut lock = Lock { device: device.clone(), before: Vec::new() };
        for knob in &KNOBS {
            let wanted = (knob.wanted)(settings);
            if settings.lock || wanted.is_some() {
                lock.hold(knob, wanted)?;
            }
        }
        Ok(lock)
    }

    /// Whether nothing was changed.
    pub(super) fn is_empty(&self) -> bool {
        self.before.is_empty()
    }

    /// Sets a knob to `wanted`, or has it stay where it is.
    fn hold(&mut self, knob: &Knob, wanted: Option<i32>) -> Result<(), Fault> {
        let automatic = self.get(knob.automatic).ok().filter(|now| now.value != (knob.manual)());
        let value = knob.values.iter().find_map(|&id| self.get(id).ok());
        if let Some(now) = automatic {
            self.change(knob, now, (knob.manual)())?;
            // The camera's own value does not always stay when it is not the camera's any more. Where it cannot be set, it stays.
            if let (Some(now), None) = (&value, wanted) {
                let _ = self.put(Control { id: now.id, value: copy(&now.value) });
            }
        }
        match (value, wanted) {
            (Some(now), Some(wanted)) => self.change(knob, now, Value::Integer(wanted.into())),
            (None, Some(_)) => Err(Fault::NoControl { control: knob.name }),
            (_, None) => Ok(()),
        }
    }

    /// Changes a control that has been as `now` says.
    fn change(&mut self, knob: &Knob, now: Control, value: Value) -> Result<(), Fault> {
        let id = now.id;
        self.before.push(now);
        let refused = |found: String| Fault::Control { control: knob.name, value: text(&value), found };
        self.put(Control { id, value: copy(&value) }).map_err(|error| refused(error.to_string()))?;
        match self.get(id) {
            // Drivers take the nearest value that they have, and say nothing.
            Ok(found) if found.value != value => Err(refused(text(&found.value))),
            _ => Ok(()),
        }
    }

    fn get(&self, id: u32) -> io::Result<Control> {
        driver::ask(|| self.device.control(id))
    }

    fn put(&self, control: Control) -> io::Result<()> {
        driver::ask(|| self.device.set_control(control))
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // A value can only be set while it is not the camera's.
        for control in mem::take(&mut self.before).into_iter().rev() {
            // A camera that is gone has forgotten it all.
            let _ = self.put(control);
        }
    }
}

/// The same value; controls of other types than these are not read.
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
