//! Animations, decoded one picture ahead.

use super::{Picture, Pictures};
use crate::dataset::decode::ImageError;
use crate::dataset::decode::other::error_of;
use crate::panics;
use image::Frames;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

type Next = Result<Picture, ImageError>;

/// Pictures from a thread of their own: the decoders of animations cannot be handed from thread to thread.
pub(super) struct Ahead {
    format: &'static str,
    pictures: Receiver<Next>,
}

impl Ahead {
    /// The frames that `open` gives.
    ///
    /// # Errors
    /// There is no further thread.
    pub fn new(
        format: &'static str,
        open: impl FnOnce() -> Result<Frames<'static>, image::ImageError> + Send + 'static,
    ) -> Result<Ahead, ImageError> {
        let (sender, pictures) = sync_channel(0);
        let decode = move || {
            let told = sender.clone();
            if let Err(detail) = panics::catch(|| send_all(format, open, &sender)) {
                let _ = told.send(Err(ImageError::Corrupt { format, detail }));
            }
        };
        thread::Builder::new().spawn(decode)?;
        Ok(Ahead { format, pictures })
    }
}

/// Sends frames until nobody wants more.
fn send_all(
    format: &'static str,
    open: impl FnOnce() -> Result<Frames<'static>, image::ImageError>,
    sender: &SyncSender<Next>,
) {
    let frames = match open() {
        Ok(frames) => frames,
        Err(e) => {
            let _ = sender.send(Err(error_of(format, e)));
            return;
        }
    };
    for frame in frames {
        let picture = frame.map(|frame| Picture::Decoded(frame.into_buffer().into()));
        let last = picture.is_err();
        if sender.send(picture.map_err(|e| error_of(format, e))).is_err() || last {
            return;
        }
    }
}

impl Pictures for Ahead {
    fn next(&mut self) -> Next {
        // Fewer than were counted.
        let end = |_| Err(ImageError::Truncated { format: self.format });
        self.pictures.recv().unwrap_or_else(end)
    }
}
