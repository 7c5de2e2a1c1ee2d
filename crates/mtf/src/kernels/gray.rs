//! Colour conversions of 8-bit pixels, in integers, so that every machine gets the same bytes.

/// BT.601 gray of interleaved R, G, B: `0.299 R + 0.587 G + 0.114 B`, rounded (weights in units of 2⁻¹⁴).
///
/// `rgb.len() == 3 * gray.len()`.
pub fn gray_from_rgb(rgb: &[u8], gray: &mut [u8]) {
    assert_eq!(rgb.len(), 3 * gray.len(), "three values per pixel");
    for (p, g) in rgb.chunks_exact(3).zip(gray) {
        let sum = 4899 * u32::from(p[0]) + 9617 * u32::from(p[1]) + 1868 * u32::from(p[2]);
        *g = ((sum + (1 << 13)) >> 14) as u8;
    }
}

/// Splits interleaved Y, Cb, Cr (JFIF, full range) into its gray plane, which is Y itself, and turns the pixels in place
/// into R, G, B: `R = Y + 1.402 (Cr - 128)`, `G = Y - 0.344136 (Cb - 128) - 0.714136 (Cr - 128)`,
/// `B = Y + 1.772 (Cb - 128)`, rounded (weights in units of 2⁻¹⁶) and clamped to 0–255.
///
/// `pixels.len() == 3 * gray.len()`.
pub fn gray_and_rgb_from_ycbcr(pixels: &mut [u8], gray: &mut [u8]) {
    assert_eq!(pixels.len(), 3 * gray.len(), "three values per pixel");
    for (p, g) in pixels.chunks_exact_mut(3).zip(gray) {
        let (y, cb, cr) = (i32::from(p[0]), i32::from(p[1]) - 128, i32::from(p[2]) - 128);
        let y16 = (y << 16) + (1 << 15);
        *g = p[0];
        p[0] = ((y16 + 91_881 * cr) >> 16).clamp(0, 255) as u8;
        p[1] = ((y16 - 22_554 * cb - 46_802 * cr) >> 16).clamp(0, 255) as u8;
        p[2] = ((y16 + 116_130 * cb) >> 16).clamp(0, 255) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gray_is_bt601_rounded() {
        let mut worst = 0.0f64;
        for i in 0..50_000u32 {
            let p = [i, i >> 5, i.wrapping_mul(2_654_435_761) >> 24].map(|v| v as u8);
            let mut g = [0];
            gray_from_rgb(&p, &mut g);
            let exact = 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]);
            worst = worst.max((f64::from(g[0]) - exact).abs());
        }
        assert!(worst < 0.51, "{worst}");
        let mut g = [0; 3];
        gray_from_rgb(&[255, 0, 0, 255, 255, 255, 0, 0, 0], &mut g);
        assert_eq!(g, [76, 255, 0]);
    }

    #[test]
    fn rgb_of_ycbcr_is_jfif_rounded() {
        for y in (0..=255u8).step_by(5) {
            for cb in (0..=255u8).step_by(3) {
                for cr in (0..=255u8).step_by(3) {
                    let (mut p, mut g) = ([y, cb, cr], [0]);
                    gray_and_rgb_from_ycbcr(&mut p, &mut g);
                    let (yf, b, r) = (f64::from(y), f64::from(cb) - 128.0, f64::from(cr) - 128.0);
                    let exact = [yf + 1.402 * r, yf - 0.344_136 * b - 0.714_136 * r, yf + 1.772 * b];
                    assert_eq!(g[0], y);
                    for (a, e) in p.iter().zip(exact) {
                        assert!((f64::from(*a) - e.clamp(0.0, 255.0)).abs() < 0.51, "{a} {e}");
                    }
                }
            }
        }
    }
}
