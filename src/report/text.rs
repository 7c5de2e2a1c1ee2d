//! Names of any characters as text: on terminals, in Markdown and in cells of spreadsheets. Depends on nothing.
//!
//! Names come from folders, files and arguments. They may hold sequences that move a terminal's cursor, marks that turn
//! the direction of writing, markup, or what a spreadsheet takes for a formula.

use std::borrow::Cow;

/// What turns on bold letters on a terminal.
pub const BOLD: &str = "\x1b[1m";
/// What ends them.
pub const PLAIN: &str = "\x1b[0m";

/// What colours the bar at the end of a line, which [`PLAIN`] ends.
pub const BAR: &str = "\x1b[36m";

/// Whether a terminal does something else with `c` than to show it.
fn is_hidden(c: char) -> bool {
    let turns_direction =
        matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || turns_direction || matches!(c, '\u{2028}' | '\u{2029}')
}

/// Hidden characters but those of `kept` as `\u001b`, which stands for the same character in a string of JSON.
fn escaped<'a>(text: &'a str, kept: &[char]) -> Cow<'a, str> {
    let escape = |c: char| is_hidden(c) && !kept.contains(&c);
    if !text.contains(escape) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if escape(c) {
            out += &format!("\\u{:04x}", u32::from(c));
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// Text in lines: control characters other than ends of lines and tabs, and marks that turn the direction of writing,
/// as `\u001b`. A line between [`BOLD`] and [`PLAIN`] keeps these two, and so does a bar at the end of a line between [`BAR`] and
/// [`PLAIN`].
pub fn lines(text: &str) -> Cow<'_, str> {
    if !text.contains(|c| is_hidden(c) && c != '\n' && c != '\t') {
        return Cow::Borrowed(text);
    }
    let line = |line: &str| {
        let (body, end) = line.strip_suffix('\n').map_or((line, ""), |body| (body, "\n"));
        match body.strip_prefix(BOLD).and_then(|b| b.strip_suffix(PLAIN)) {
            Some(bold) => format!("{BOLD}{}{PLAIN}{end}", escaped(bold, &['\t'])),
            None => {
                let (body, bar) = bar_at_end(body);
                format!("{}{bar}{end}", escaped(body, &['\t']))
            }
        }
    };
    Cow::Owned(text.split_inclusive('\n').map(line).collect())
}

/// A line without the bar at its end, and the bar with its colour: nothing but shaded blocks.
fn bar_at_end(line: &str) -> (&str, &str) {
    let bar = line.rfind(BAR).and_then(|at| {
        let blocks = line[at + BAR.len()..].strip_suffix(PLAIN)?;
        let is_bar = blocks.chars().all(|c| ('\u{2580}'..='\u{259f}').contains(&c));
        is_bar.then_some(at)
    });
    line.split_at(bar.unwrap_or(line.len()))
}

/// As [`lines`], ends of lines and tabs escaped as well.
pub fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, &[])
}

/// Text that stands for itself in Markdown, in a cell of a table, too: no markup, links, images or further cells.
pub fn markdown(text: &str) -> String {
    let text = one_line(text);
    let mut out = String::with_capacity(text.len() + 8);
    let mut before = ' ';
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        let after = rest.peek().copied().unwrap_or(' ');
        let marks = match c {
            '\\' | '`' | '*' | '[' | ']' | '<' | '>' | '&' | '|' | '~' | '$' => true,
            // Within a word it is a letter.
            '_' => !(before.is_alphanumeric() && after.is_alphanumeric()),
            // Where addresses are recognised: `http://`, `www.`
            ':' => after == '/',
            '.' => before == 'w' || before == 'W',
            '#' => before == ' ',
            _ => false,
        };
        if marks {
            out.push('\\');
        }
        out.push(c);
        before = c;
    }
    out
}

/// A cell of a spreadsheet that is no formula: an apostrophe goes before text that begins like one. Numbers are as they are.
pub fn cell(text: &str) -> Cow<'_, str> {
    let formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    // A dash stands for no value.
    if formula && text != "-" && text.parse::<f64>().is_err() {
        return Cow::Owned(format!("'{text}"));
    }
    Cow::Borrowed(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_hidden_reaches_a_terminal() {
        assert_eq!(
            one_line("a\x1b[31mb\u{9b}\u{202e}\n"),
            "a\\u001b[31mb\\u009b\\u202e\\u000a"
        );
        assert_eq!(lines("a\tb\nc\x1b[1md\n"), "a\tb\nc\\u001b[1md\n");
        let bold = format!("{BOLD}a\rb{PLAIN}\n{BOLD}c\n");
        assert_eq!(lines(&bold), format!("{BOLD}a\\u000db{PLAIN}\n\\u001b[1mc\n"));
        let bar = format!("a{BAR}██▓░{PLAIN}\n");
        assert_eq!(lines(&bar), bar);
        for other in [
            format!("{BAR}██ a{PLAIN}\n"),
            format!("{BAR}█{PLAIN} a\n"),
            format!("{BAR}█\n"),
        ] {
            assert!(!lines(&other).contains('\x1b'), "{other:?}");
        }
        assert!(matches!(lines("esm/ssd é 日本\n"), Cow::Borrowed(_)));
    }

    #[test]
    fn escapes_are_the_same_string_in_json() {
        let name = "a\u{202e}\u{7f}\u{80}\x1b\n";
        let document = serde_json::to_string(&[name]).unwrap();
        let shown = lines(&document);
        assert!(!shown.contains(is_hidden));
        assert_eq!(serde_json::from_str::<[String; 1]>(&shown).unwrap(), [name]);
    }

    #[test]
    fn markup_is_text_in_markdown() {
        for (text, expected) in [
            ("esm/ssd/affine{max_iters=5}", "esm/ssd/affine{max_iters=5}"),
            ("al_median -0.5", "al_median -0.5"),
            ("a|b\nc", "a\\|b\\\\u000ac"),
            ("<img src=x>", "\\<img src=x\\>"),
            ("![x](y)`z`", "!\\[x\\](y)\\`z\\`"),
            ("__b__ *i* ~s~ $m$", "\\_\\_b\\_\\_ \\*i\\* \\~s\\~ \\$m\\$"),
            ("http://a www.b &lt;", "http\\://a www\\.b \\&lt;"),
        ] {
            assert_eq!(markdown(text), expected);
        }
    }

    #[test]
    fn cells_are_no_formulas() {
        for text in ["=1+1", "+a", "-cmd", "@x", "\tx", "\rx", "-2+3"] {
            assert_eq!(cell(text), format!("'{text}"));
        }
        for text in ["-0.25", "+8.0000", "-inf", "-", "", "a=b", "1e-3"] {
            assert_eq!(cell(text), text);
        }
    }
}
