//! Panics as failures: a bug in one tracker must not end a run of thousands.

use std::cell::{Cell, RefCell};
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

thread_local! {
    static CATCHING: Cell<bool> = const { Cell::new(false) };
    static MESSAGE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Runs `f`; a panic in it becomes an error with its message and, after [`install_hook`], its place in the source.
///
/// # Errors
/// The message of the panic.
pub fn catch<T>(f: impl FnOnce() -> T) -> Result<T, String> {
    let outer = CATCHING.replace(true);
    // What is seen after a panic is dropped by every caller, so a broken invariant in it cannot spread.
    let result = catch_unwind(AssertUnwindSafe(f));
    CATCHING.set(outer);
    result.map_err(|payload| {
        let text = MESSAGE.take().or_else(|| {
            let text = payload.downcast_ref::<&str>().map(|s| s.to_string());
            text.or_else(|| payload.downcast_ref::<String>().cloned())
        });
        text.unwrap_or_else(|| "panic without a message".into())
    })
}

/// Makes panics inside [`catch`] silent and keeps their place for its error; others print one line. For programs;
/// replaces the process's panic hook, once.
pub fn install_hook() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        std::panic::set_hook(Box::new(|info| {
            let message = info.payload_as_str().unwrap_or("panic without a message");
            // One line, whatever the message: assertions print several.
            let message = message.split_whitespace().collect::<Vec<_>>().join(" ");
            let place = info
                .location()
                .map(|l| format!(" ({}:{})", l.file(), l.line()))
                .unwrap_or_default();
            if CATCHING.get() {
                MESSAGE.set(Some(format!("{message}{place}")));
            } else {
                // Not `eprintln`, which panics where standard error is gone: within a panic that ends the process at once.
                let line = format!("internal error: {message}{place}; this is a bug, please report it");
                let _ = writeln!(io::stderr(), "{line}");
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_become_errors_with_their_message() {
        assert_eq!(catch(|| 3), Ok(3));
        let inner = catch(|| {
            let _ = catch(|| panic!("inner"));
            panic!("outer {}", 1)
        });
        let inner: String = inner.map(|_: ()| ()).unwrap_err();
        assert!(inner.starts_with("outer 1"), "{inner}");
        assert!(!CATCHING.get());
    }
}
