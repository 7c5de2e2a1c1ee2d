//! JPEG.

use super::huffman::STANDARD_TABLES;
use super::{Depth16, ImageError, ImageKind, Remark, check_size, entropy, is_turned, one_line, turn};
use image::ImageFormat;
use image::metadata::Orientation;
use mtf::image::Pixels;
use std::borrow::Cow;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;

const NAME: &str = "JPEG";

pub(super) const KIND: ImageKind = ImageKind {
    name: NAME,
    extensions: &["jpg", "jpeg"],
    format: ImageFormat::Jpeg,
    size,
    decode,
    remarks,
};

fn size(_: &ImageKind, bytes: &[u8]) -> Result<(usize, usize), ImageError> {
    let decoder = opened(bytes).map_err(|e| error_of(bytes, bytes, e))?;
    let (width, height) = claimed_size(&decoder)?;
    Ok(match is_turned(orientation(&decoder)) {
        true => (height, width),
        false => (width, height),
    })
}

/// A decoder that has read the headers.
fn opened(bytes: &[u8]) -> Result<JpegDecoder<ZCursor<&[u8]>>, DecodeErrors> {
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options());
    decoder.decode_headers()?;
    Ok(decoder)
}

/// How the picture is to be turned, as its Exif data says.
fn orientation(decoder: &JpegDecoder<ZCursor<&[u8]>>) -> Orientation {
    let exif = decoder.exif().and_then(|exif| Orientation::from_exif_chunk(exif));
    exif.unwrap_or(Orientation::NoTransforms)
}

fn remarks(_: &ImageKind, bytes: &[u8]) -> Vec<Remark> {
    let markers = walk(bytes);
    let turned = opened(bytes).map_or(Orientation::NoTransforms, |decoder| orientation(&decoder));
    let mut remarks: Vec<Remark> = Remark::turned(turned).into_iter().collect();
    if markers.lacks_tables {
        remarks.push(Remark::StandardTables);
    }
    if !markers.reaches_end {
        remarks.push(Remark::NoEndMark);
    }
    remarks
}

/// The file with what every decoder adds: the standard Huffman tables where it has none, as a frame of Motion JPEG, and the
/// mark of its end.
fn completed<'a>(bytes: &'a [u8], markers: &Markers) -> Cow<'a, [u8]> {
    if markers.reaches_end && !markers.lacks_tables {
        return bytes.into();
    }
    const START: usize = 2;
    let (start, rest) = bytes.split_at(START.min(bytes.len()));
    let tables: &[u8] = if markers.lacks_tables {
        &STANDARD_TABLES
    } else {
        &[]
    };
    let (rest, end): (_, &[u8]) = match markers.reaches_end {
        true => (rest, &[]),
        // The first half of a mark that was cut in two.
        false => (rest.strip_suffix(&[0xff]).unwrap_or(rest), &[0xff, 0xd9]),
    };
    [start, tables, rest, end].concat().into()
}

fn options() -> DecoderOptions {
    // Strict: bad entropy-coded data must be an error, not a frame that is gray from there on.
    DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(1 << 16)
        .set_max_height(1 << 16)
}

fn claimed_size(decoder: &JpegDecoder<ZCursor<&[u8]>>) -> Result<(usize, usize), ImageError> {
    let (width, height) = decoder.dimensions().unwrap_or((0, 0));
    check_size(width as u64, height as u64)?;
    Ok((width, height))
}

fn decode(_: &ImageKind, bytes: &[u8], colour: bool, _: Depth16) -> Result<Pixels, ImageError> {
    let found = walk(bytes);
    let complete = completed(bytes, &found);
    let markers = walk(&complete);
    let guarded = markers.only_scan_ends_at.map(|end| guarded(&complete, end));
    let failed = |e| error_of(bytes, &complete, e);
    let mut decoder = opened(guarded.as_deref().unwrap_or(&complete)).map_err(failed)?;
    let (width, height) = claimed_size(&decoder)?;
    // Without an end mark, only the codes tell whether the picture is all there.
    if !found.reaches_end && !entropy::is_whole(&complete) {
        return Err(ImageError::Truncated { format: NAME });
    }
    if !markers.known_sampling() {
        let detail = format!("chroma sampling factors {:02x?}", markers.sampling);
        return Err(ImageError::Unsupported { format: NAME, detail });
    }
    // The Y plane is gray by definition (BT.601); files that have none are converted to R, G, B first.
    let output = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => ColorSpace::Luma,
        Some(ColorSpace::YCbCr) if !colour && markers.plain_luma() => ColorSpace::Luma,
        Some(ColorSpace::YCbCr) => ColorSpace::YCbCr,
        _ => ColorSpace::RGB,
    };
    let orientation = orientation(&decoder);
    decoder.set_options(options().jpeg_set_out_colorspace(output));
    let pixels = decoder.decode().map_err(failed)?;
    // A guard has failed the decoder already.
    if guarded.is_none() && entropy::ends_early(&complete) {
        return Err(ImageError::Truncated { format: NAME });
    }
    if pixels.len() != width * height * output.num_components() {
        let detail = "the decoder returned another number of pixels".into();
        return Err(ImageError::Corrupt { format: NAME, detail });
    }
    let channels = output.num_components();
    let (width, height, pixels) = turn(width, height, channels, pixels, orientation);
    Ok(match output {
        ColorSpace::Luma => Pixels::from_gray(width, height, pixels),
        ColorSpace::YCbCr => Pixels::from_ycbcr(width, height, pixels, colour),
        _ if colour => Pixels::from_rgb(width, height, pixels),
        _ => Pixels::from_rgb(width, height, pixels).without_colour(),
    })
}

/// What the markers of a JPEG file say.
#[derive(Default)]
struct Markers {
    /// They lead to an end-of-image marker. Decoders fill what is missing with gray.
    reaches_end: bool,
    /// A scan comes before any Huffman table.
    lacks_tables: bool,
    /// Where the codes of the only scan end, when it is all there is before the end of the image: no other scan, no
    /// restart markers.
    only_scan_ends_at: Option<usize>,
    /// Sequential, not progressive.
    sequential: bool,
    /// Horizontal (high four bits) and vertical (low four bits) sampling factor of each component.
    sampling: Vec<u8>,
}

impl Markers {
    /// The decoder's gray output is its Y plane to the bit. It is not for progressive 4:4:0, whose rows it mixes up.
    fn plain_luma(&self) -> bool {
        self.sequential && matches!(self.sampling[..], [0x11 | 0x21 | 0x22, 0x11, 0x11])
    }

    /// The decoder's pixels are right: full or one of the usual chroma resolutions. It garbles 4:1:0 and the like.
    fn known_sampling(&self) -> bool {
        match self.sampling[..] {
            [_] => true,
            [0x11 | 0x21 | 0x12 | 0x22 | 0x41, 0x11, 0x11] => true,
            [first @ (0x11 | 0x21 | 0x12 | 0x22), 0x11, 0x11, black] => first == black,
            _ => false,
        }
    }
}

/// One bits, 16 bytes of them with the zeros that keep them from being markers: more than the decoder reads ahead.
const GUARD: [u8; 32] = {
    let mut guard = [0xff; 32];
    let mut k = 1;
    while k < guard.len() {
        guard[k] = 0;
        k += 2;
    }
    guard
};

/// The file with one bits where the codes of its only scan end. The decoder goes on with zeros when a marker comes before
/// the last block, and zeros are codes; ones are none (ITU-T T.81, C.2), so that a scan that ends early is an error. The
/// decoder never gets to them otherwise. Costs a copy, where [`entropy`] reads each code once more.
fn guarded(bytes: &[u8], end: usize) -> Vec<u8> {
    [&bytes[..end], &GUARD, &bytes[end..]].concat()
}

fn walk(bytes: &[u8]) -> Markers {
    let mut found = Markers::default();
    let mut tables = false;
    let (mut at, mut in_scan, mut scans, mut restarts) = (0, false, 0, false);
    while let Some(step) = bytes
        .get(at..)
        .and_then(|rest| rest.iter().position(|&b| b == 0xff))
    {
        at += step;
        match bytes.get(at + 1) {
            None => break,
            Some(0xd9) => {
                found.reaches_end = true;
                found.only_scan_ends_at =
                    (in_scan && scans == 1 && !restarts && found.sequential).then_some(at);
                break;
            }
            Some(0xff) => at += 1, // fill byte
            // Stuffed byte or a marker without a segment.
            Some(marker @ (0x00 | 0x01 | 0xd0..=0xd8)) => {
                restarts |= matches!(marker, 0xd0..=0xd7);
                at += 2;
            }
            Some(marker) => {
                let Some(&[high, low]) = bytes.get(at + 2..at + 4) else {
                    break;
                };
                let length = usize::from(u16::from_be_bytes([high, low]));
                let start_of_frame = matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc);
                if let (true, Some([_, _, _, _, _, _, components @ ..])) =
                    (start_of_frame, bytes.get(at + 4..at + 2 + length))
                {
                    found.sequential = *marker <= 0xc1;
                    found.sampling = components.chunks_exact(3).map(|component| component[1]).collect();
                }
                tables |= *marker == 0xc4;
                in_scan = *marker == 0xda;
                found.lacks_tables |= in_scan && !tables && found.sequential;
                restarts |= *marker == 0xdd;
                scans += usize::from(in_scan);
                at += 2 + length;
            }
        }
    }
    found
}

/// Of the file `bytes`, which was decoded as `complete`.
fn error_of(bytes: &[u8], complete: &[u8], error: DecodeErrors) -> ImageError {
    let format = NAME;
    match error {
        _ if !walk(bytes).reaches_end || entropy::ends_early(complete) => ImageError::Truncated { format },
        DecodeErrors::ExhaustedData | DecodeErrors::IoErrors(_) => ImageError::Truncated { format },
        DecodeErrors::Unsupported(scheme) => ImageError::Unsupported {
            format,
            detail: format!("{scheme:?}"),
        },
        other => ImageError::Corrupt {
            format,
            detail: one_line(&other.to_string()),
        },
    }
}
