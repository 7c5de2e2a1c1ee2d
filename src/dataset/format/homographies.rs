//! Image sets with homographies, HPatches' and Oxford's: images numbered from 1 and, for each but the first, a text file
//! `H_1_k` (or `H1tokp`) with the nine numbers of the matrix that takes image 1 to image k.
//!
//! The object is what the whole first image shows, as in the measure of corner errors that these sets are used with: its
//! corners are the centres of the four outermost pixels, and the matrices carry them to the other images.

use super::{Description, Format, Found, Place, TruthFile};
use crate::dataset::annotation::{Annotations, Region};
use crate::dataset::decode::dimensions;
use crate::dataset::names::stem;
use crate::dataset::storage::File;
use crate::dataset::{DatasetError, DatasetErrorKind, rows};
use mtf::geom::{Corners, Mat3, homography};

/// See the module.
pub(super) struct Homographies;

/// The number of the image that a file's homography leads to: `k` of `H_1_k`, `H1tokp` or `H1tok`, also with `.txt`.
fn target(name: &str) -> Option<usize> {
    let name = name.strip_suffix(".txt").unwrap_or(name);
    let number = match name.strip_prefix("H_1_") {
        Some(number) => number,
        None => {
            let number = name.strip_prefix("H1to")?;
            number.strip_suffix('p').unwrap_or(number)
        }
    };
    number.parse().ok()
}

/// The last number in the name of an image.
fn number_of(image: &File) -> Option<usize> {
    let stem = stem(image.name());
    let digits = stem.len() - stem.bytes().rev().take_while(u8::is_ascii_digit).count();
    stem[digits..].parse().ok()
}

impl Format for Homographies {
    fn describe(&self) -> Description {
        Description {
            name: "homographies",
            summary: "image sets with a homography from the first image to each other: HPatches, Oxford",
            layout: "numbered images and homographies `H_1_2` or `H1to2p` to each from the first",
            conventions: "origin 0 (pixel centres at integers); the object is the whole first image; an image without a homography \
                          is a fault",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let is_homography = |file: &&File| target(file.name()).is_some();
        let truth: Vec<File> = place.files().iter().filter(is_homography).cloned().collect();
        let frames = place.images();
        if truth.is_empty() || frames.is_empty() {
            return Ok(vec![]);
        }
        Ok(vec![place.sequence(frames, truth)])
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let first = &sequence.frames[0];
        let size = dimensions(&first.read()?).map_err(|e| DatasetError::new(first.path(), e.into()))?;
        let [width, height] = [size.0, size.1].map(|n| n as f64);
        let object = Corners::rect(0.0, 0.0, width - 1.0, height - 1.0);
        for (i, frame) in sequence.frames.iter().enumerate() {
            let number = number_of(frame);
            if i == 0 && number == Some(1) {
                let location = super::Location::file(frame.path());
                annotations.set(i, location, Ok(Region::Corners(object)));
                continue;
            }
            let file = truth
                .iter()
                .find(|file| number.is_some() && target(file.name()) == number);
            match file {
                Some(file) => {
                    let moved = matrix(file).map(|m| Region::Corners(homography::apply_corners(&m, &object)));
                    annotations.set(i, file.location(), moved);
                }
                None => annotations.fault(DatasetError::new(
                    frame.path(),
                    DatasetErrorKind::Format {
                        fault: "no homography leads to this image".into(),
                        remedy: "add the file `H_1_k`, with k the number in the image's name".into(),
                    },
                )),
            }
        }
        Ok(())
    }
}

fn matrix(file: &TruthFile) -> Result<Mat3, DatasetErrorKind> {
    let text = file.text().map_err(|e| e.kind)?;
    let words: Vec<&str> = rows::words(&text).collect();
    Ok(Mat3::from_row_slice(&rows::numbers(&words, 9)?))
}
