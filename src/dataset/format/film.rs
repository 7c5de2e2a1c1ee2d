//! Films: files with several pictures, ground truth in a text file of the same name beside each.

use super::{Description, Format, Found, Place};
use crate::dataset::DatasetError;
use crate::dataset::movie::{Movie, film_stem};
use crate::dataset::names::stem;
use crate::dataset::storage::File;

/// See the module.
pub(super) struct Film;

impl Format for Film {
    fn describe(&self) -> Description {
        Description {
            name: "film",
            summary: "films, each a file with several pictures: Motion-JPEG AVI, animated GIF or PNG, pages of TIFF",
            layout: "`SEQ.avi`, `SEQ.gif`, `SEQ.png` or `SEQ.tif` with several pictures and `SEQ.txt` beside it",
            conventions: "corners as UL UR LR LL, origin 0 (pixel centres at integers), a row per picture in order; or boxes as \
                          x y w h, origin 0.5 (at the corner of the first pixel)",
        }
    }

    fn holds_sequences(&self) -> bool {
        true
    }

    /// Looks into files that have a text file of their name beside them.
    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let found = |film: File| {
            let name = film_stem(film.name())
                .unwrap_or_else(|| stem(film.name()))
                .to_owned();
            let truth = place.file(&format!("{name}.txt"))?.clone();
            Some(Found {
                name,
                frames: vec![film],
                truth: vec![truth],
                ..Found::default()
            })
        };
        let films = place
            .files()
            .iter()
            .filter(|file| film_stem(file.name()).is_some())
            .cloned();
        let found: Vec<Found> = place
            .still_images()
            .into_iter()
            .chain(films)
            .filter_map(found)
            .collect();
        // A damaged one is a film, too.
        let is_film = |found: &Found| !matches!(Movie::of(&found.frames[0]), Ok(None));
        Ok(match found.iter().all(is_film) {
            true => found,
            false => Vec::new(),
        })
    }
}
