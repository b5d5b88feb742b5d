//! Panics of other crates, as errors.

use std::{
    any::Any,
    cell::Cell,
    panic::{self, AssertUnwindSafe},
    sync::Once,
    thread,
};

thread_local! {
    /// True while a panic of this thread becomes an error.
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Runs `call`. If it panics, nothing is printed, and the message is returned. Other panics are printed as before.
pub fn caught<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    static QUIET: Once = Once::new();
    // A thread that panics already may not change the hook.
    if !thread::panicking() {
        QUIET.call_once(|| {
            let print = panic::take_hook();
            panic::set_hook(Box::new(move |info| {
                if !IS_CAUGHT.get() {
                    print(info);
                }
            }));
        });
    }
    let before = IS_CAUGHT.replace(true);
    // What `call` has changed is lost with it.
    let result = panic::catch_unwind(AssertUnwindSafe(call));
    IS_CAUGHT.set(before);
    result.map_err(|payload| message(&*payload))
}

fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("unknown").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_its_message() {
        assert_eq!(caught(|| 7), Ok(7));
        assert_eq!(caught(|| -> u8 { panic!("a table") }), Err("a table".into()));
        assert_eq!(caught(|| -> u8 { panic!("entry {}", 3) }), Err("entry 3".into()));
        assert!(!IS_CAUGHT.get());
    }
}
