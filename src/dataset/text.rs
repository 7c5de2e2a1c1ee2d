//! Text as people write it: how it is encoded, its lines, the words of a line.
//!
//! Depends on the names of images alone.

use super::decode::is_image_name;
use std::borrow::Cow;

/// The text that `bytes` hold: UTF-8, UTF-16 in either order, else Latin-1. A byte order mark in front, and blanks, zeros
/// and the end mark of DOS (Ctrl-Z) behind are left out. `None` when it is no text.
pub(super) fn decode(bytes: &[u8]) -> Option<Cow<'_, str>> {
    let text = match utf16(bytes) {
        Some(units) => Cow::Owned(String::from_utf16(&units?).ok()?),
        None => match std::str::from_utf8(bytes) {
            Ok(text) => Cow::Borrowed(text),
            Err(_) if bytes.contains(&0) => return None,
            // Each byte is the code point of its letter.
            Err(_) => Cow::Owned(bytes.iter().map(|&b| char::from(b)).collect()),
        },
    };
    let cut = |text: &str| {
        let behind = |c: char| c.is_whitespace() || c == '\0' || c == CTRL_Z;
        let begin = text.len() - text.trim_start_matches('\u{feff}').len();
        begin..text.trim_end_matches(behind).len().max(begin)
    };
    Some(match text {
        Cow::Borrowed(text) => Cow::Borrowed(&text[cut(text)]),
        Cow::Owned(text) => Cow::Owned(text[cut(&text)].to_owned()),
    })
}

/// Where texts end on DOS.
const CTRL_Z: char = '\u{1a}';

/// The units of UTF-16 text, `Some(None)` when half of one is missing; `None` when it is not UTF-16: there is no byte order
/// mark, and not every other byte is zero, as it is where all letters are Latin.
fn utf16(bytes: &[u8]) -> Option<Option<Vec<u16>>> {
    let start = &bytes[..bytes.len().min(64) & !1];
    let zeros = |odd: usize| start.chunks(2).all(|pair| pair[odd] == 0 && pair[1 - odd] != 0);
    let unit: fn([u8; 2]) -> u16 = match bytes {
        [0xff, 0xfe, ..] => u16::from_le_bytes,
        [0xfe, 0xff, ..] => u16::from_be_bytes,
        _ if start.is_empty() => return None,
        _ if zeros(1) => u16::from_le_bytes,
        _ if zeros(0) => u16::from_be_bytes,
        _ => return None,
    };
    let whole = bytes.len().is_multiple_of(2);
    Some(whole.then(|| {
        bytes
            .chunks_exact(2)
            .map(|pair| unit([pair[0], pair[1]]))
            .collect()
    }))
}

/// The lines of a text, whichever of CR, LF and CR LF ends them.
pub fn lines(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.split('\n');
    lines.flat_map(|line| line.strip_suffix('\r').unwrap_or(line).split('\r'))
}

/// Whether `c` stands between words: any kind of blank, a comma, semicolon, bracket or mark of quotation.
fn separates(c: char) -> bool {
    c.is_whitespace() || ",;[](){}\"'\u{feff}\u{200b}".contains(c)
}

/// The words of a text. What is in quotation marks and has letters in it is one word.
pub fn words(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = text;
    std::iter::from_fn(move || {
        let start = rest.trim_start_matches(separates);
        let quote = rest[..rest.len() - start.len()].chars().next_back();
        if let Some(quote) = quote.filter(|c| "\"'".contains(*c))
            && let Some((word, after)) = start.split_once(quote)
            && word.contains(separates)
            && word
                .split(separates)
                .any(|part| !part.is_empty() && !is_number(part))
        {
            rest = after;
            return Some(word.trim());
        }
        let end = start.find(separates).unwrap_or(start.len());
        rest = &start[end..];
        (end > 0).then(|| &start[..end])
    })
}

/// Whether `word` spells a number; `nan` and `inf` do.
pub(super) fn is_number(word: &str) -> bool {
    word.parse::<f64>().is_ok()
}

/// The words of a row of truth. The name of a frame that comes first is one word, also when it has blanks in it.
pub(super) fn row(line: &str) -> Vec<&str> {
    let line = line.trim();
    let (name, rest) = name(line);
    name.into_iter().chain(words(rest)).collect()
}

/// A name in front of a row that has blanks or brackets in it, and what is behind.
fn name(line: &str) -> (Option<&str>, &str) {
    let none = (None, line);
    if line.starts_with(['"', '\'']) || !line.contains(char::is_alphabetic) {
        return none;
    }
    // The extension of an image ends it.
    let listed = |c: char| matches!(c, '\t' | ',' | ';');
    for (end, c) in line.char_indices().chain([(line.len(), ' ')]) {
        if (separates(c) || c == ':') && is_image_name(&line[..end]) {
            return (Some(&line[..end]), line[end..].trim_start_matches(':'));
        }
        if listed(c) {
            break;
        }
    }
    // Or the first separator that is no blank, when only numbers follow.
    let Some((front, rest)) = line.split_once(listed) else {
        return none;
    };
    let front = front.trim_end();
    let blank = front.contains(' ') && front.starts_with(char::is_alphabetic);
    let named = blank && !words(front).all(is_number);
    match named && words(rest).all(is_number) && words(rest).next().is_some() {
        true => (Some(front), rest),
        false => none,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings() {
        let text = "# größe\n1,2";
        let utf16 = |unit: fn(u16) -> [u8; 2], mark: bool| -> Vec<u8> {
            let mark = mark.then_some(0xfeff);
            mark.into_iter()
                .chain(text.encode_utf16())
                .flat_map(unit)
                .collect()
        };
        let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            format!("\u{feff}{text}").into_bytes(),
            format!("{text}\r\n\u{1a}").into_bytes(),
            format!("{text}\n\0\0").into_bytes(),
            latin.clone(),
            [&latin[..], b"\n\x1a"].concat(),
            utf16(u16::to_le_bytes, true),
            utf16(u16::to_be_bytes, true),
            utf16(u16::to_le_bytes, false),
            utf16(u16::to_be_bytes, false),
        ] {
            assert_eq!(decode(&bytes).as_deref(), Some(text), "{bytes:?}");
        }
        for bytes in [&b"\xff\xfe\x00"[..], b"\x89PNG\x00\xff", b"\xff\xfe\x00\xd8"] {
            assert_eq!(decode(bytes), None, "{bytes:?}");
        }
        for bytes in [&b""[..], b"\x1a", b"\n \0", "\u{feff}".as_bytes()] {
            assert_eq!(decode(bytes).as_deref(), Some(""), "{bytes:?}");
        }
    }

    #[test]
    fn ends_of_lines() {
        for text in ["a\nb\n\nc", "a\r\nb\r\n\r\nc", "a\rb\r\rc"] {
            let found: Vec<&str> = lines(text).collect();
            assert_eq!(found, ["a", "b", "", "c"], "{text:?}");
        }
    }

    #[test]
    fn rows_of_many_hands() {
        for (line, expected) in [
            ("1 2\t3,4;5 , 6", &["1", "2", "3", "4", "5", "6"][..]),
            ("[1, 2], [3, 4]", &["1", "2", "3", "4"]),
            ("((1,2),(3,4))", &["1", "2", "3", "4"]),
            ("{1;2}", &["1", "2"]),
            ("1\u{a0}2\u{2003}3", &["1", "2", "3"]),
            ("\"1\",\"2\"", &["1", "2"]),
            ("\"1,2,3\"", &["1", "2", "3"]),
            ("\"a.png\",\"1\",\"2\"", &["a.png", "1", "2"]),
            ("'my frame 1.png', 1, 2", &["my frame 1.png", "1", "2"]),
            ("\"frame 1\",1", &["frame 1", "1"]),
            ("my frame (1).png 1 2", &["my frame (1).png", "1", "2"]),
            ("a.png: 1 2", &["a.png", "1", "2"]),
            ("img/a b/00001.jpg,1,2", &["img/a b/00001.jpg", "1", "2"]),
            ("C:\\data\\1.png 1 2", &["C:\\data\\1.png", "1", "2"]),
            ("frame 1\t1\t2", &["frame 1", "1", "2"]),
            ("frame1 1 2", &["frame1", "1", "2"]),
            ("nan nan, nan nan", &["nan", "nan", "nan", "nan"]),
            ("[nan nan, nan nan]", &["nan", "nan", "nan", "nan"]),
            ("frame ulx, uly", &["frame", "ulx", "uly"]),
            ("00001.png,,,", &["00001.png"]),
            (",,,", &[]),
        ] {
            assert_eq!(row(line), expected, "{line}");
        }
    }
}
