//! JPEG.

use super::{ImageError, ImageKind, check_size, entropy, one_line};
use image::ImageFormat;
use mtf::image::Pixels;
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
};

fn size(_: &ImageKind, bytes: &[u8]) -> Result<(usize, usize), ImageError> {
    claimed_size(&opened(bytes)?)
}

/// A decoder that has read the headers.
fn opened(bytes: &[u8]) -> Result<JpegDecoder<ZCursor<&[u8]>>, ImageError> {
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options());
    decoder.decode_headers().map_err(|e| error_of(bytes, e))?;
    Ok(decoder)
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

fn decode(_: &ImageKind, bytes: &[u8], colour: bool) -> Result<Pixels, ImageError> {
    let markers = walk(bytes);
    let guarded = markers.only_scan_ends_at.map(|end| guarded(bytes, end));
    let mut decoder = opened(guarded.as_deref().unwrap_or(bytes))?;
    let (width, height) = claimed_size(&decoder)?;
    if !markers.reaches_end {
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
    decoder.set_options(options().jpeg_set_out_colorspace(output));
    let pixels = decoder.decode().map_err(|e| error_of(bytes, e))?;
    // A guard has failed the decoder already.
    if guarded.is_none() && entropy::ends_early(bytes) {
        return Err(ImageError::Truncated { format: NAME });
    }
    if pixels.len() != width * height * output.num_components() {
        let detail = "the decoder returned another number of pixels".into();
        return Err(ImageError::Corrupt { format: NAME, detail });
    }
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
                in_scan = *marker == 0xda;
                restarts |= *marker == 0xdd;
                scans += usize::from(in_scan);
                at += 2 + length;
            }
        }
    }
    found
}

fn error_of(bytes: &[u8], error: DecodeErrors) -> ImageError {
    let format = NAME;
    match error {
        _ if !walk(bytes).reaches_end || entropy::ends_early(bytes) => ImageError::Truncated { format },
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
