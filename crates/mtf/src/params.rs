//! Typed parameters of appearance models, state space models and search methods.
//!
//! [`params!`](crate::params!) declares a struct together with the table that `list params`, `--set` and tracker expressions read:
//! name, default, allowed range and documentation live in one place. Depends on nothing else in the crate.

use std::fmt::{self, Display};

/// Name and text of the value of one parameter.
pub type Assignment<'a> = (&'a str, &'a str);

/// Something built from assignments.
pub type Built<T> = Result<T, ParamError>;

/// One parameter as users see it.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ParamInfo {
    /// Name in expressions and `--set`.
    pub name: &'static str,
    /// Default value, as it would be written.
    pub default: String,
    /// Allowed values.
    pub allowed: String,
    /// One-line description.
    pub doc: &'static str,
    /// The family of parts that its values are names of ("appearance model"), if they are names. Which names there are is
    /// known to the registry.
    pub names: Option<&'static str>,
    /// What of a model it changes; all if empty.
    pub changes: &'static [Use],
    /// Its value in the paper, or in the original where the paper has none, if the default is another.
    pub paper: Option<PaperValue>,
}

/// What a search method may use of an appearance model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum Use {
    /// Similarities of patches.
    Scores,
    /// Gradients and Hessians of the similarity.
    Derivatives,
    /// Distances between features.
    Distances,
}

/// Value of a parameter as published, where the default is another.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PaperValue {
    /// The value, as it would be written.
    pub value: String,
    /// One line: why the default is another, with the figures of both.
    pub why: &'static str,
}

/// A parameter assignment that cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParamError {
    /// No parameter of that name.
    #[error("unknown parameter '{name}'")]
    Unknown {
        /// The name given.
        name: String,
    },
    /// The text is not a value of the parameter's type or range.
    #[error("{name}={value}: expected {allowed}")]
    Value {
        /// Parameter.
        name: &'static str,
        /// Text given.
        value: String,
        /// What is allowed.
        allowed: String,
    },
    /// The text is of the parameter's type, but what it names cannot be used.
    #[error("{name}={value}: {reason}")]
    Unusable {
        /// Parameter.
        name: &'static str,
        /// Text given.
        value: String,
        /// Why.
        reason: String,
    },
}

impl ParamError {
    /// The parameter, and the text given for it.
    pub fn culprit(&self) -> (&str, Option<&str>) {
        match self {
            ParamError::Unknown { name } => (name, None),
            ParamError::Value { name, value, .. } | ParamError::Unusable { name, value, .. } => {
                (name, Some(value))
            }
        }
    }

    /// The error for a text that `T` did not accept as parameter `name`, of which `allowed` would be.
    pub fn refused<T: ParamValue>(name: &'static str, value: &str, allowed: String) -> Self {
        let value = value.to_owned();
        match T::explain(&value) {
            Some(reason) => ParamError::Unusable { name, value, reason },
            None => ParamError::Value { name, value, allowed },
        }
    }
}

/// A set of typed parameters with defaults.
pub trait Params: Default + Clone + Send + 'static {
    /// Table of all parameters.
    fn info() -> Vec<ParamInfo>;
    /// Sets `name` from text.
    fn set(&mut self, name: &str, value: &str) -> Result<(), ParamError>;
    /// Canonical text of `name`'s value.
    fn get(&self, name: &str) -> Option<String>;

    /// Defaults with `assignments` applied in order.
    fn from_assignments(assignments: &[Assignment<'_>]) -> Built<Self> {
        let mut p = Self::default();
        for (name, value) in assignments {
            p.set(name, value)?;
        }
        Ok(p)
    }
}

/// Parameters of a model that has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NoParams;

impl Params for NoParams {
    fn info() -> Vec<ParamInfo> {
        Vec::new()
    }
    fn set(&mut self, name: &str, _value: &str) -> Result<(), ParamError> {
        Err(ParamError::Unknown {
            name: name.to_owned(),
        })
    }
    fn get(&self, _name: &str) -> Option<String> {
        None
    }
}

/// Two sets side by side: what a family shares and what one member adds.
impl<A: Params, B: Params> Params for (A, B) {
    fn info() -> Vec<ParamInfo> {
        A::info().into_iter().chain(B::info()).collect()
    }
    fn set(&mut self, name: &str, value: &str) -> Result<(), ParamError> {
        match self.0.set(name, value) {
            Err(ParamError::Unknown { .. }) => self.1.set(name, value),
            done => done,
        }
    }
    fn get(&self, name: &str) -> Option<String> {
        self.0.get(name).or_else(|| self.1.get(name))
    }
}

/// A type that parameters may have.
pub trait ParamValue: Sized + Clone + PartialEq {
    /// The family of parts that values are names of, if they are ([`ParamInfo::names`]).
    const NAMES: Option<&'static str> = None;
    /// From text; `None` when it is not of this type.
    fn parse(text: &str) -> Option<Self>;
    /// Canonical text.
    fn text(&self) -> String;
    /// What is allowed when no range is declared.
    fn allowed() -> String;
    /// Why a text that is not accepted cannot be, if more is to be said than what is allowed.
    fn explain(_text: &str) -> Option<String> {
        None
    }
}

macro_rules! number {
    ($($t:ty => $what:literal),*) => {$(
        impl ParamValue for $t {
            fn parse(text: &str) -> Option<Self> {
                text.parse().ok()
            }
            fn text(&self) -> String {
                self.to_string()
            }
            fn allowed() -> String {
                $what.to_owned()
            }
        }
    )*};
}
number!(u32 => "a whole number", usize => "a whole number");

impl ParamValue for f64 {
    fn parse(text: &str) -> Option<Self> {
        text.parse().ok().filter(|v: &f64| v.is_finite())
    }
    fn text(&self) -> String {
        // Shortest text that reads back the same; powers of ten far from 1 in exponent form.
        if *self != 0.0 && (self.abs() < 1e-3 || self.abs() >= 1e7) {
            format!("{self:e}")
        } else {
            self.to_string()
        }
    }
    fn allowed() -> String {
        "a number".to_owned()
    }
}

impl ParamValue for bool {
    fn parse(text: &str) -> Option<Self> {
        match text.to_ascii_lowercase().as_str() {
            "1" | "true" | "on" | "yes" => Some(true),
            "0" | "false" | "off" | "no" => Some(false),
            _ => None,
        }
    }
    fn text(&self) -> String {
        if *self { "1" } else { "0" }.to_owned()
    }
    fn allowed() -> String {
        "0 or 1".to_owned()
    }
}

/// Points in columns and rows: columns x rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resolution {
    /// Points per row.
    pub cols: usize,
    /// Rows.
    pub rows: usize,
}

impl Resolution {
    /// Number of points.
    pub fn len(self) -> usize {
        self.cols * self.rows
    }
    /// True when there are no points.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }
}

impl Display for Resolution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.cols, self.rows)
    }
}

impl ParamValue for Resolution {
    fn parse(text: &str) -> Option<Self> {
        let (cols, rows) = text.split_once(['x', 'X']).unwrap_or((text, text));
        let side = |s: &str| s.parse().ok().filter(|n| (2..=1000).contains(n));
        Some(Resolution {
            cols: side(cols)?,
            rows: side(rows)?,
        })
    }
    fn text(&self) -> String {
        self.to_string()
    }
    fn allowed() -> String {
        "COLSxROWS or one number, 2 to 1000 each".to_owned()
    }
}

/// Declares an enum that is a parameter: variants with their names in text.
macro_rules! param_enum {
    ($(#[$meta:meta])* $vis:vis enum $name:ident { $($(#[$vmeta:meta])* $variant:ident = $text:literal),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        $vis enum $name { $($(#[$vmeta])* $variant),* }

        impl $crate::params::ParamValue for $name {
            fn parse(text: &str) -> Option<Self> {
                match text.to_ascii_lowercase().as_str() { $($text => Some($name::$variant),)* _ => None }
            }
            fn text(&self) -> String {
                match self { $($name::$variant => $text),* }.to_owned()
            }
            fn allowed() -> String {
                [$($text),*].join(", ")
            }
        }
    };
}
pub(crate) use param_enum;

/// Declares a parameter struct: fields with documentation, type, default and, each optional, an inclusive range, what of an
/// appearance model it changes (`changes [Derivatives]`), and the value published with the reason why the default is another.
///
/// ```
/// mtf::params! {
///     /// Parameters of a blur.
///     pub struct BlurParams {
///         /// Standard deviation, px.
///         sigma: f64 = 3.0, in 0.1..=30.0, paper 1.0 => "less noise";
///     }
/// }
/// use mtf::params::Params;
/// assert!(BlurParams::from_assignments(&[("sigma", "50")]).is_err());
/// assert_eq!(BlurParams::info()[0].paper.as_ref().unwrap().value, "1");
/// ```
#[macro_export]
macro_rules! params {
    ($(#[$meta:meta])* $vis:vis struct $name:ident {
        $($(#[doc = $doc:literal])+ $field:ident : $ty:ty = $default:expr $(, in $range:expr)? $(, changes [$($use:ident),+])? $(, paper $paper:expr => $why:literal)?;)*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        $vis struct $name { $($(#[doc = $doc])+ pub $field: $ty),* }

        impl Default for $name {
            fn default() -> Self {
                $name { $($field: $default),* }
            }
        }

        impl $crate::params::Params for $name {
            fn info() -> Vec<$crate::params::ParamInfo> {
                use $crate::params::ParamValue;
                let d = $name::default();
                vec![$($crate::params::ParamInfo {
                    name: stringify!($field),
                    default: d.$field.text(),
                    allowed: {
                        #[allow(unused_mut, unused_assignments)]
                        let mut allowed = <$ty as ParamValue>::allowed();
                        $({
                            let range: std::ops::RangeInclusive<$ty> = $range;
                            allowed = format!("{} to {}", range.start().text(), range.end().text());
                        })?
                        allowed
                    },
                    doc: concat!($($doc),+).trim_ascii_start(),
                    names: <$ty as ParamValue>::NAMES,
                    changes: &[$($($crate::params::Use::$use),+)?],
                    paper: {
                        #[allow(unused_mut, unused_assignments)]
                        let mut paper = None;
                        $({
                            let value: $ty = $paper;
                            paper = Some($crate::params::PaperValue { value: value.text(), why: $why });
                        })?
                        paper
                    },
                }),*]
            }
            fn set(&mut self, name: &str, value: &str) -> Result<(), $crate::params::ParamError> {
                use $crate::params::ParamValue;
                $(if name == stringify!($field) {
                    let parsed = <$ty as ParamValue>::parse(value)$(.filter(|v| $range.contains(v)))?;
                    self.$field = parsed.ok_or_else(|| {
                        let info = <Self as $crate::params::Params>::info();
                        let own = info.into_iter().find(|i| i.name == stringify!($field)).expect("declared");
                        $crate::params::ParamError::refused::<$ty>(own.name, value, own.allowed)
                    })?;
                    return Ok(());
                })*
                Err($crate::params::ParamError::Unknown { name: name.to_owned() })
            }
            fn get(&self, name: &str) -> Option<String> {
                use $crate::params::ParamValue;
                $(if name == stringify!($field) { return Some(self.$field.text()); })*
                None
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::params! {
        /// For tests.
        struct Demo {
            /// A count.
            count: usize = 30, in 1..=100;
            /// A step.
            step: f64 = 1e-4;
            /// A switch.
            on: bool = false;
        }
    }

    #[test]
    fn values_are_checked_and_canonical() {
        let p = Demo::from_assignments(&[("count", "7"), ("step", "0.0001"), ("on", "true")]).unwrap();
        assert_eq!((p.count, p.step, p.on), (7, 1e-4, true));
        assert_eq!(p.get("step").unwrap(), "1e-4");
        assert_eq!(p.get("on").unwrap(), "1");
        let error = Demo::from_assignments(&[("count", "0")]).unwrap_err();
        assert_eq!(error.to_string(), "count=0: expected 1 to 100");
        assert!(Demo::from_assignments(&[("step", "nan")]).is_err());
        assert_eq!(Demo::info()[0].doc, "A count.");
        assert!(matches!(
            p.clone().set("nope", "1"),
            Err(ParamError::Unknown { .. })
        ));
    }

    #[test]
    fn resolution_text() {
        assert_eq!(Resolution::parse("25"), Some(Resolution { cols: 25, rows: 25 }));
        assert_eq!(Resolution::parse("40x30").unwrap().text(), "40x30");
        assert_eq!(Resolution::parse("1x9"), None);
    }
}
