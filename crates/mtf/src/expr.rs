//! The notation of trackers, before any name is looked up:
//!
//! ```text
//! tracker    = ( bare | single | composite ) [ "{" settings "}" ]
//! bare       = name
//! single     = name "/" name [ "+" name ] "/" name
//! composite  = name "(" [ tracker { "," tracker } ] [ ";" settings ] ")"
//! settings   = [ name "=" value { "," name "=" value } ]
//! ```
//!
//! Blanks between words do not matter, nor does the letter case of names; values keep theirs. Errors say where in the text
//! (a byte offset) and what was expected there. Depends on nothing else in the crate.

/// A word of the text and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Word {
    /// Lower case.
    pub text: String,
    /// Byte offset.
    pub at: usize,
}

/// What a tracker is made of.
#[derive(Clone, Debug, PartialEq)]
pub enum Head {
    /// A name alone: a composite without members, or a search method with the models that are the default.
    Bare {
        /// The name.
        name: Word,
    },
    /// `sm/am+ilm/ssm`.
    Single {
        /// Search method.
        sm: Word,
        /// Appearance model.
        am: Word,
        /// Illumination model.
        ilm: Option<Word>,
        /// State space model.
        ssm: Word,
    },
    /// `name(members)`.
    Composite {
        /// Kind.
        name: Word,
        /// Members in order.
        members: Vec<Expr>,
    },
}

/// A parsed tracker.
#[derive(Clone, Debug, PartialEq)]
pub struct Expr {
    /// Its parts.
    pub head: Head,
    /// Names (possibly qualified) and values, in order.
    pub settings: Vec<(Word, String)>,
}

/// A text that is no tracker.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntaxError {
    /// Byte offset of the fault.
    pub at: usize,
    /// What was expected there.
    pub expected: &'static str,
}

/// Deepest nesting.
const MAX_DEPTH: usize = 32;

/// Parses a tracker.
///
/// # Errors
/// Where the text departs from the notation.
pub fn parse(text: &str) -> Result<Expr, SyntaxError> {
    let mut parser = Parser {
        text: text.to_owned(),
        at: 0,
    };
    let expr = parser.tracker(0)?;
    parser.blanks();
    match parser.rest().is_empty() {
        true => Ok(expr),
        false => Err(parser.fault("the end")),
    }
}

struct Parser {
    text: String,
    at: usize,
}

impl Parser {
    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    fn blanks(&mut self) {
        let rest = self.rest();
        self.at += rest.len() - rest.trim_start().len();
    }

    fn fault(&self, expected: &'static str) -> SyntaxError {
        SyntaxError {
            at: self.at,
            expected,
        }
    }

    /// Takes the sign if it comes next.
    fn take(&mut self, sign: char) -> bool {
        self.blanks();
        let found = self.rest().starts_with(sign);
        self.at += if found { sign.len_utf8() } else { 0 };
        found
    }

    fn word(&mut self, expected: &'static str) -> Result<Word, SyntaxError> {
        self.blanks();
        let rest = self.rest();
        let end = rest
            .find(|c: char| !(c.is_ascii_alphanumeric() || "_.-".contains(c)))
            .unwrap_or(rest.len());
        if end == 0 {
            return Err(self.fault(expected));
        }
        let word = Word {
            text: rest[..end].to_ascii_lowercase(),
            at: self.at,
        };
        self.at += end;
        Ok(word)
    }

    fn tracker(&mut self, depth: usize) -> Result<Expr, SyntaxError> {
        if depth > MAX_DEPTH {
            return Err(self.fault("less nesting"));
        }
        let name = self.word("a tracker")?;
        let mut settings = Vec::new();
        let head = if self.take('/') {
            let am = self.word("an appearance model")?;
            let ilm = if self.take('+') {
                Some(self.word("an illumination model")?)
            } else {
                None
            };
            if !self.take('/') {
                return Err(self.fault("'/' and a state space model"));
            }
            let ssm = self.word("a state space model")?;
            Head::Single {
                sm: name,
                am,
                ilm,
                ssm,
            }
        } else if self.take('(') {
            let mut members = Vec::new();
            self.blanks();
            if !self.rest().starts_with([';', ')']) {
                members.push(self.tracker(depth + 1)?);
                while self.take(',') {
                    members.push(self.tracker(depth + 1)?);
                }
            }
            if self.take(';') {
                self.settings(')', &mut settings)?;
            }
            if !self.take(')') {
                return Err(self.fault("',', ';' or ')'"));
            }
            Head::Composite { name, members }
        } else {
            Head::Bare { name }
        };
        if self.take('{') {
            self.settings('}', &mut settings)?;
            if !self.take('}') {
                return Err(self.fault("',' or '}'"));
            }
        }
        Ok(Expr { head, settings })
    }

    fn settings(&mut self, close: char, out: &mut Vec<(Word, String)>) -> Result<(), SyntaxError> {
        self.blanks();
        if self.rest().starts_with(close) {
            return Ok(());
        }
        loop {
            let name = self.word("the name of a parameter")?;
            if !self.take('=') {
                return Err(self.fault("'=' and a value"));
            }
            let rest = self.rest();
            let end = rest.find([',', close]).unwrap_or(rest.len());
            let value = rest[..end].trim();
            if value.is_empty() {
                return Err(self.fault("a value"));
            }
            out.push((name, value.to_owned()));
            self.at += end;
            if !self.take(',') {
                return Ok(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn show(e: &Expr) -> String {
        let settings: Vec<String> = e
            .settings
            .iter()
            .map(|(n, v)| format!("{}={v}", n.text))
            .collect();
        let head = match &e.head {
            Head::Bare { name } => name.text.clone(),
            Head::Single { sm, am, ilm, ssm } => {
                let ilm = ilm.as_ref().map_or(String::new(), |i| format!("+{}", i.text));
                format!("{}/{}{ilm}/{}", sm.text, am.text, ssm.text)
            }
            Head::Composite { name, members } => {
                let members: Vec<String> = members.iter().map(show).collect();
                format!("{}({})", name.text, members.join(","))
            }
        };
        format!("{head}{{{}}}", settings.join(","))
    }

    #[test]
    fn trackers_nest() {
        for (text, canonical) in [
            ("esm/ssd/homography", "esm/ssd/homography{}"),
            (
                " ESM / SSD + gb/ Homography { max_iters = 50 , res=25x25 } ",
                "esm/ssd+gb/homography{max_iters=50,res=25x25}",
            ),
            ("best", "best{}"),
            ("lmes {res=9}", "lmes{res=9}"),
            ("best()", "best(){}"),
            ("DFM/x/Y{Model=Net.onnx}", "dfm/x/y{model=Net.onnx}"),
            ("best(; levels=4)", "best(){levels=4}"),
            (
                "cascade(pyramid(iclk/ssd/affine{sm.iclk.epsilon=1e-3}; levels=3), esm/zncc/homography)",
                "cascade(pyramid(iclk/ssd/affine{sm.iclk.epsilon=1e-3}){levels=3},esm/zncc/homography{}){}",
            ),
            (
                "grid(flow; ssm=homography, size=10x10){a=1}",
                "grid(flow{}){ssm=homography,size=10x10,a=1}",
            ),
        ] {
            assert_eq!(show(&parse(text).unwrap()), canonical);
        }
    }

    #[test]
    fn faults_are_placed() {
        for (text, at, expected) in [
            ("", 0, "a tracker"),
            ("esm/", 4, "an appearance model"),
            ("esm/ssd", 7, "'/' and a state space model"),
            ("esm/ssd+/affine", 8, "an illumination model"),
            ("esm/ssd/affine/x", 14, "the end"),
            ("esm/ssd/affine{max_iters}", 24, "'=' and a value"),
            ("esm/ssd/affine{max_iters=}", 25, "a value"),
            ("esm/ssd/affine{max_iters=5", 26, "',' or '}'"),
            ("cascade(esm/ssd/affine", 22, "',', ';' or ')'"),
            ("cascade(esm/ssd/affine,)", 23, "a tracker"),
            ("cascade(esm/ssd/affine; )x", 25, "the end"),
            ("é", 0, "a tracker"),
        ] {
            let error = parse(text).unwrap_err();
            assert_eq!((error.at, error.expected), (at, expected), "{text}");
        }
        assert_eq!(parse(&"a(".repeat(100)).unwrap_err().expected, "less nesting");
    }

    proptest! {
        #[test]
        fn any_text_is_read_without_panic(text in "\\PC{0,40}") {
            let _ = parse(&text);
        }

        #[test]
        fn near_misses_are_read_without_panic(text in "[a-c/+{}();,=é ]{0,30}") {
            if let Err(e) = parse(&text) {
                prop_assert!(e.at <= text.len());
            }
        }
    }
}
