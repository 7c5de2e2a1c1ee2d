//! Whether the entropy-coded data of a JPEG is all there.
//!
//! Decoders go on with zeros where a scan ends before its last block, as long as a marker follows, so that the rest of the
//! picture is made up. This walks through the codes of each scan (ITU-T T.81, annexes F and G: sequential and progressive
//! Huffman coding) without making coefficients, and asks nothing but whether the bits last to the end of each restart
//! interval. What is wrong in any other way is the decoder's to say.

/// Why a walk ends.
enum Stop {
    /// A restart interval has fewer bits than its blocks take.
    Short,
    /// The file is not as this walk understands it.
    Unclear,
}

/// Codes of up to so many bits are looked up at once.
const LOOK: u32 = 9;

/// A Huffman table.
struct Codes {
    /// Length in bits (high byte) and symbol (low byte) by the next [`LOOK`] bits; 0: a longer code.
    short: [u16; 1 << LOOK],
    /// By length: one more than the last code, shifted up to 16 bits; 0 without codes.
    end: [u32; 17],
    /// By length: index of the symbol of code 0.
    first: [i32; 17],
    symbols: Vec<u8>,
}

impl Codes {
    /// Of the number of codes of each length and their symbols.
    fn new(counts: &[u8], symbols: &[u8]) -> Codes {
        let mut codes = Codes {
            short: [0; 1 << LOOK],
            end: [0; 17],
            first: [0; 17],
            symbols: symbols.to_vec(),
        };
        let (mut code, mut index) = (0u32, 0usize);
        for (length, &count) in (1u32..).zip(counts) {
            codes.first[length as usize] = index as i32 - code as i32;
            for &symbol in symbols.iter().skip(index).take(count.into()) {
                if length <= LOOK {
                    let from = (code << (LOOK - length)) as usize;
                    let until = from + (1 << (LOOK - length));
                    if let Some(places) = codes.short.get_mut(from..until) {
                        places.fill((length << 8) as u16 | u16::from(symbol));
                    }
                }
                code += 1;
            }
            index += usize::from(count);
            codes.end[length as usize] = if count == 0 { 0 } else { code << (16 - length) };
            code <<= 1;
        }
        codes
    }
}

/// The bits of a restart interval: up to the next marker, stuffed bytes taken out.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    buffer: u64,
    left: u32,
}

impl Bits<'_> {
    /// Holds at least 16 bits afterwards, or all that are left.
    fn fill(&mut self) {
        while self.left <= 56 {
            let Some(&byte) = self.bytes.get(self.at) else {
                return;
            };
            if byte == 0xff {
                if self.bytes.get(self.at + 1) != Some(&0) {
                    return;
                }
                self.at += 1;
            }
            self.at += 1;
            self.buffer = self.buffer << 8 | u64::from(byte);
            self.left += 8;
        }
    }

    /// The next `n` bits, at most 16.
    fn take(&mut self, n: u32) -> Result<u32, Stop> {
        if self.left < n {
            self.fill();
        }
        self.left = self.left.checked_sub(n).ok_or(Stop::Short)?;
        Ok((self.buffer >> self.left) as u32 & ((1 << n) - 1))
    }

    /// The next symbol.
    fn symbol(&mut self, codes: &Codes) -> Result<u8, Stop> {
        if self.left < 16 {
            self.fill();
        }
        // Zeros stand for what is not there; a code that needs them is too long.
        let next = match self.left {
            16.. => (self.buffer >> (self.left - 16)) as u32 & 0xffff,
            left => ((self.buffer << (16 - left)) as u32) & 0xffff,
        };
        let short = codes.short[(next >> (16 - LOOK)) as usize];
        let (length, symbol) = if short > 0 {
            (u32::from(short >> 8), short as u8)
        } else {
            let length = (LOOK + 1..=16).find(|&n| next < codes.end[n as usize]);
            let Some(length) = length else {
                return Err(if self.left < 16 {
                    Stop::Short
                } else {
                    Stop::Unclear
                });
            };
            let index = (next >> (16 - length)) as i32 + codes.first[length as usize];
            let symbol = usize::try_from(index).ok().and_then(|i| codes.symbols.get(i));
            (length, *symbol.ok_or(Stop::Unclear)?)
        };
        self.left = self.left.checked_sub(length).ok_or(Stop::Short)?;
        Ok(symbol)
    }

    /// To the next interval, past its marker.
    fn restart(&mut self) -> Result<(), Stop> {
        (self.buffer, self.left) = (0, 0);
        match self.skip_to_marker() {
            Some(0xd0..=0xd7) => {
                self.at += 2;
                Ok(())
            }
            // The scan ends where it should go on.
            _ => Err(Stop::Short),
        }
    }

    /// Goes to the next marker, fill bytes passed over, and says which.
    fn skip_to_marker(&mut self) -> Option<u8> {
        loop {
            self.at += self.bytes.get(self.at..)?.iter().position(|&b| b == 0xff)?;
            match *self.bytes.get(self.at + 1)? {
                0 => self.at += 2,
                0xff => self.at += 1,
                marker => return Some(marker),
            }
        }
    }
}

/// A component of the picture.
struct Component {
    id: u8,
    /// Sampling factors.
    across: usize,
    down: usize,
    /// Blocks that cover it, in a scan of its own.
    blocks: [usize; 2],
    /// Of each coefficient of a block, in zigzag order: low bits that no scan has coded so far.
    uncoded: [u8; 64],
    /// Of each block, which coefficients are not 0, in zigzag order; kept for progressive files.
    nonzero: Vec<u64>,
}

/// What a scan codes.
#[derive(Clone, Copy)]
struct Band {
    first: u32,
    last: u32,
    refines: bool,
}

#[derive(Default)]
struct Picture {
    components: Vec<Component>,
    /// Blocks per unit are `across` x `down` of each component; units across and down.
    units: [usize; 2],
    progressive: bool,
    /// DC and AC tables.
    codes: [[Option<Codes>; 4]; 2],
    /// Units between restart markers; 0: none.
    interval: usize,
}

/// Whether a scan in the JPEG file `bytes` ends before its last block.
pub(super) fn ends_early(bytes: &[u8]) -> bool {
    matches!(walk(bytes), Err(Stop::Short))
}

/// Whether the scans in the JPEG file `bytes` are all there and code every bit of every coefficient.
pub(super) fn is_whole(bytes: &[u8]) -> bool {
    let whole = |c: &Component| c.uncoded.iter().all(|&bits| bits == 0);
    walk(bytes).is_ok_and(|picture| !picture.components.is_empty() && picture.components.iter().all(whole))
}

fn walk(bytes: &[u8]) -> Result<Picture, Stop> {
    let mut picture = Picture::default();
    let mut at = 2;
    loop {
        let mut bits = Bits {
            bytes,
            at,
            buffer: 0,
            left: 0,
        };
        let marker = bits.skip_to_marker().ok_or(Stop::Unclear)?;
        at = bits.at + 2;
        match marker {
            0xd9 => return Ok(picture),
            0x01 | 0xd0..=0xd8 => continue,
            _ => {}
        }
        let length = match bytes.get(at..at + 2) {
            Some(&[high, low]) => usize::from(u16::from_be_bytes([high, low])),
            _ => return Err(Stop::Unclear),
        };
        let segment = bytes.get(at + 2..at + length).ok_or(Stop::Unclear)?;
        at += length;
        match marker {
            0xc0..=0xc2 => picture.frame(segment, marker == 0xc2).ok_or(Stop::Unclear)?,
            0xc4 => picture.tables(segment).ok_or(Stop::Unclear)?,
            // Lossless, hierarchical and arithmetic coding.
            0xc3 | 0xc5..=0xcf => return Err(Stop::Unclear),
            0xdd => {
                let [high, low] = *segment else {
                    return Err(Stop::Unclear);
                };
                picture.interval = u16::from_be_bytes([high, low]).into();
            }
            0xda => at = picture.scan(segment, bytes, at)?,
            _ => {}
        }
    }
}

impl Picture {
    fn frame(&mut self, segment: &[u8], progressive: bool) -> Option<()> {
        let [8, y1, y0, x1, x0, _, components @ ..] = segment else {
            return None;
        };
        let height = usize::from(u16::from_be_bytes([*y1, *y0]));
        let width = usize::from(u16::from_be_bytes([*x1, *x0]));
        let factors = |c: &[u8]| (usize::from(c[1] >> 4), usize::from(c[1] & 15));
        let list: Vec<&[u8]> = components.chunks_exact(3).collect();
        let most_across = list.iter().map(|c| factors(c).0).max()?;
        let most_down = list.iter().map(|c| factors(c).1).max()?;
        if height == 0 || width == 0 || list.iter().any(|c| factors(c).0 == 0 || factors(c).1 == 0) {
            return None;
        }
        self.progressive = progressive;
        self.units = [width.div_ceil(8 * most_across), height.div_ceil(8 * most_down)];
        self.components = list
            .iter()
            .map(|c| {
                let (across, down) = factors(c);
                let blocks = [
                    (width * across).div_ceil(most_across).div_ceil(8),
                    (height * down).div_ceil(most_down).div_ceil(8),
                ];
                let kept = if progressive { blocks[0] * blocks[1] } else { 0 };
                Component {
                    id: c[0],
                    across,
                    down,
                    blocks,
                    uncoded: [u8::MAX; 64],
                    nonzero: vec![0; kept],
                }
            })
            .collect();
        Some(())
    }

    fn tables(&mut self, mut segment: &[u8]) -> Option<()> {
        while let [place, rest @ ..] = segment {
            let counts = rest.get(..16)?;
            let symbols = counts.iter().map(|&n| usize::from(n)).sum::<usize>();
            let table = self.codes.get_mut(usize::from(place >> 4))?;
            *table.get_mut(usize::from(place & 15))? = Some(Codes::new(counts, rest.get(16..16 + symbols)?));
            segment = &rest[16 + symbols..];
        }
        Some(())
    }

    /// Walks through the scan at `at`; returns where it ends.
    fn scan(&mut self, segment: &[u8], bytes: &[u8], at: usize) -> Result<usize, Stop> {
        let [count, rest @ ..] = segment else {
            return Err(Stop::Unclear);
        };
        let count = usize::from(*count);
        let (Some(list), Some(&[first, last, approximation])) =
            (rest.get(..2 * count), rest.get(2 * count..))
        else {
            return Err(Stop::Unclear);
        };
        let band = match self.progressive {
            true => Band {
                first: first.into(),
                last: last.into(),
                refines: approximation >> 4 > 0,
            },
            false => Band {
                first: 0,
                last: 63,
                refines: false,
            },
        };
        if band.last > 63 || band.first > band.last || self.progressive && band.first == 0 && band.last > 0 {
            return Err(Stop::Unclear);
        }
        let Picture {
            components,
            codes: [dc, ac],
            units,
            ..
        } = self;
        let mut parts = Vec::new();
        for pair in list.chunks_exact(2) {
            let component = components.iter().position(|c| c.id == pair[0]);
            let tables = [
                dc.get(usize::from(pair[1] >> 4)),
                ac.get(usize::from(pair[1] & 15)),
            ];
            parts.push((
                component.ok_or(Stop::Unclear)?,
                tables.map(|t| t.and_then(Option::as_ref)),
            ));
        }
        let alone = parts.len() == 1;
        let [wide, high] = match parts[..] {
            [(component, _)] => components[component].blocks,
            [] => return Err(Stop::Unclear),
            _ => *units,
        };
        let mut bits = Bits {
            bytes,
            at,
            buffer: 0,
            left: 0,
        };
        let mut run = 0;
        for unit in 0..wide * high {
            if self.interval > 0 && unit > 0 && unit % self.interval == 0 {
                bits.restart()?;
                run = 0;
            }
            for &(index, tables) in &parts {
                let component = &mut components[index];
                let blocks = if alone {
                    1
                } else {
                    component.across * component.down
                };
                for _ in 0..blocks {
                    let mut none = 0;
                    let nonzero = component.nonzero.get_mut(unit).unwrap_or(&mut none);
                    match (self.progressive, band.first) {
                        (false, _) => sequential(&mut bits, tables)?,
                        (true, 0) if band.refines => bits.take(1).map(drop)?,
                        (true, 0) => difference(&mut bits, tables[0])?,
                        (true, _) if band.refines => refine(&mut bits, tables[1], band, nonzero, &mut run)?,
                        (true, _) => begin(&mut bits, tables[1], band, nonzero, &mut run)?,
                    }
                }
            }
        }
        for &(index, _) in &parts {
            let coded = band.first as usize..=band.last as usize;
            components[index].uncoded[coded].fill(if self.progressive { approximation & 15 } else { 0 });
        }
        bits.skip_to_marker();
        Ok(bits.at)
    }
}

/// The first coefficient of a block, as the difference from the last block's.
fn difference(bits: &mut Bits<'_>, dc: Option<&Codes>) -> Result<(), Stop> {
    let size = bits.symbol(dc.ok_or(Stop::Unclear)?)?;
    bits.take(u32::from(size.min(16))).map(drop)
}

/// All of a block.
fn sequential(bits: &mut Bits<'_>, [dc, ac]: [Option<&Codes>; 2]) -> Result<(), Stop> {
    difference(bits, dc)?;
    let ac = ac.ok_or(Stop::Unclear)?;
    let mut k = 1;
    while k < 64 {
        let symbol = bits.symbol(ac)?;
        match (symbol >> 4, symbol & 15) {
            (15, 0) => k += 16,
            (_, 0) => break,
            (zeros, size) => {
                k += u32::from(zeros) + 1;
                bits.take(size.into())?;
            }
        }
    }
    Ok(())
}

/// The first bits of the coefficients of a band. `run`: blocks that have none, from this one on.
fn begin(
    bits: &mut Bits<'_>,
    ac: Option<&Codes>,
    band: Band,
    nonzero: &mut u64,
    run: &mut u32,
) -> Result<(), Stop> {
    if *run > 0 {
        *run -= 1;
        return Ok(());
    }
    let ac = ac.ok_or(Stop::Unclear)?;
    let mut k = band.first;
    while k <= band.last {
        let symbol = bits.symbol(ac)?;
        match (u32::from(symbol >> 4), u32::from(symbol & 15)) {
            (15, 0) => k += 16,
            (zeros, 0) => {
                *run = (1 << zeros) + bits.take(zeros)? - 1;
                break;
            }
            (zeros, size) => {
                k += zeros;
                *nonzero |= 1 << k.min(63);
                bits.take(size)?;
                k += 1;
            }
        }
    }
    Ok(())
}

/// One more bit of the coefficients of a band: of those that are not 0, and some that were.
fn refine(
    bits: &mut Bits<'_>,
    ac: Option<&Codes>,
    band: Band,
    nonzero: &mut u64,
    run: &mut u32,
) -> Result<(), Stop> {
    let ac = ac.ok_or(Stop::Unclear)?;
    let mut k = band.first;
    while *run == 0 && k <= band.last {
        let symbol = bits.symbol(ac)?;
        let (mut zeros, size) = (u32::from(symbol >> 4), symbol & 15);
        if size == 0 && zeros < 15 {
            *run = (1 << zeros) + bits.take(zeros)?;
            break;
        }
        if size > 0 {
            // The sign of the new one.
            bits.take(1)?;
        }
        while k <= band.last {
            if *nonzero >> k & 1 == 1 {
                bits.take(1)?;
            } else if zeros == 0 {
                break;
            } else {
                zeros -= 1;
            }
            k += 1;
        }
        if size > 0 && k <= band.last {
            *nonzero |= 1 << k;
        }
        k += 1;
    }
    if *run > 0 {
        while k <= band.last {
            if *nonzero >> k & 1 == 1 {
                bits.take(1)?;
            }
            k += 1;
        }
        *run -= 1;
    }
    Ok(())
}
