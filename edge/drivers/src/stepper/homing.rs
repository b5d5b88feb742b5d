//! Looks for the switch at the low end of an axis.

use super::{axis::Axis, drive::AxisId, error::StepperError, ramp::Ramp};

/// The retreat is slower than the approach by this factor, because its speed limits the precision.
const RETREAT_SLOWDOWN: u32 = 8;

/// The homing of one axis: towards the switch until it is pressed, then slowly back until it is released.
#[derive(Clone, Copy, Debug)]
pub(super) struct Homing {
    pub axis: AxisId,
    /// True if the stage knew its position before.
    pub was_homed: bool,
    phase: HomingPhase,
    steps_left: u32,
    ramp: Ramp,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum HomingPhase {
    Approach,
    Retreat,
}

/// The next step.
pub(super) enum HomingAction {
    /// Make a step in the direction `way`, `interval` nanoseconds after the one before.
    Step { way: i32, interval: u32 },
    /// The switch is pressed: [retreat](Homing::retreat).
    Retreat,
    /// The switch is released: the axis is at its reference.
    Found,
}

impl Homing {
    /// Starts towards the switch.
    pub fn approach(axis: AxisId, limits: &Axis, was_homed: bool) -> Homing {
        let ramp = Ramp::new(limits.steps_of(limits.homing_um_per_s), limits.steps_of(limits.acceleration_um_per_s2));
        Homing { axis, was_homed, phase: HomingPhase::Approach, steps_left: limits.homing_steps(), ramp }
    }

    /// Turns back from the switch.
    pub fn retreat(self, limits: &Axis) -> Homing {
        let speed = limits.steps_of(limits.homing_um_per_s / RETREAT_SLOWDOWN);
        let ramp = Ramp::new(speed, limits.steps_of(limits.acceleration_um_per_s2));
        Homing { phase: HomingPhase::Retreat, steps_left: limits.steps_of(limits.release_um), ramp, ..self }
    }

    /// The next step, given the switch.
    ///
    /// # Errors
    /// The switch was not pressed or released within its distance.
    pub fn next(&mut self, is_pressed: bool) -> Result<HomingAction, StepperError> {
        let axis = self.axis;
        match self.phase {
            HomingPhase::Approach if is_pressed => return Ok(HomingAction::Retreat),
            HomingPhase::Retreat if !is_pressed => return Ok(HomingAction::Found),
            HomingPhase::Approach if self.steps_left == 0 => return Err(StepperError::SwitchNotFound { axis }),
            HomingPhase::Retreat if self.steps_left == 0 => return Err(StepperError::SwitchStuck { axis }),
            HomingPhase::Approach | HomingPhase::Retreat => {}
        }
        let interval = self.ramp.interval(self.steps_left);
        self.steps_left -= 1;
        let way = if self.phase == HomingPhase::Approach { -1 } else { 1 };
        Ok(HomingAction::Step { way, interval })
    }
}
