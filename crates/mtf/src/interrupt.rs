//! Ending long work early: whoever calls a tracker hands it a [`Token`], and long loops look whether it has been set.
//! Depends on nothing else in the crate.
//!
//! ```
//! use mtf::interrupt::{self, Token};
//!
//! let token = Token::default();
//! assert!(interrupt::with(&token, interrupt::check).is_ok());
//! // By another thread, at a deadline, say.
//! token.interrupt();
//! assert!(interrupt::with(&token, interrupt::check).is_err());
//! assert!(interrupt::check().is_ok());
//! ```

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Asks the work it was given to to end. Clones are the same token.
#[derive(Clone, Debug, Default)]
pub struct Token(Arc<AtomicBool>);

/// The work was asked to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

thread_local! {
    static CURRENT: RefCell<Option<Token>> = const { RefCell::new(None) };
}

impl Token {
    /// Asks for the end, for good.
    pub fn interrupt(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether `other` is the same token.
    pub fn is(&self, other: &Token) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// Whether the end has been asked for.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Does `work` under a token, and puts the one before it back, also after a panic.
pub fn with<R>(token: &Token, work: impl FnOnce() -> R) -> R {
    under(Some(token.clone()), work)
}

/// Does `work` under the token of another thread, if that had one.
pub(crate) fn under<R>(token: Option<Token>, work: impl FnOnce() -> R) -> R {
    struct Back(Option<Token>);
    impl Drop for Back {
        fn drop(&mut self) {
            CURRENT.set(self.0.take());
        }
    }
    let _back = Back(CURRENT.replace(token));
    work()
}

/// The token of this thread.
pub(crate) fn current() -> Option<Token> {
    CURRENT.with_borrow(Clone::clone)
}

/// Whether the work of this thread is to end. Cheap enough for every sample, patch or iteration; not for every pixel.
pub fn requested() -> bool {
    CURRENT.with_borrow(|token| token.as_ref().is_some_and(Token::is_set))
}

/// Fails when the work of this thread is to end.
///
/// # Errors
/// [`Interrupted`].
pub fn check() -> Result<(), Interrupted> {
    if requested() { Err(Interrupted) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_token_before_comes_back() {
        let (outer, inner) = (Token::default(), Token::default());
        inner.interrupt();
        with(&outer, || {
            assert!(std::panic::catch_unwind(|| with(&inner, || panic!("{:?}", check()))).is_err());
            assert_eq!(check(), Ok(()));
            assert_eq!(with(&inner, check), Err(Interrupted));
            outer.interrupt();
            assert!(requested());
        });
        assert!(!requested());
    }
}
