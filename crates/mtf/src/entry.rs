//! Rows of the tables of models and methods: what users see of a part that is built by name. Depends on `params` alone.

use crate::params::{Assignment, Built, ParamError, ParamInfo, ParamValue, Params};
use std::marker::PhantomData;

/// What a part says of itself to be listed and built by name. A model that implements this beside its family's trait can be
/// added to the registry.
pub trait Part: Sized + 'static {
    /// Its parameters.
    type Params: Params;
    /// Name, lower case, as in the literature.
    const NAME: &'static str;
    /// Other names users may type.
    const ALIASES: &'static [&'static str] = &[];
    /// One line for `list`.
    const SUMMARY: &'static str;
    /// Builds it.
    fn new(params: Self::Params) -> Self;
}

/// A family of parts: how its members are built, and what its rows say beyond those of other families.
pub trait Family: Clone {
    /// Builds a member from `(name, value)` assignments and what else the family needs.
    type Build: Copy;
    /// What a member is called in messages.
    const ROLE: &'static str;
    /// Whether members belong to groups. Those of no group are then for analysis, and `all` leaves them out.
    const GROUPED: bool = false;

    /// Whether a member is itself made of others of its family, and so cannot be one of them.
    fn made_of_others(&self) -> bool {
        false
    }

    /// What a parameter that names one of `known` allows, in words.
    fn names_allowed(_known: &[Entry<Self>]) -> String {
        format!("a {}", Self::ROLE)
    }
}

/// Builds a part from `(name, value)` assignments alone.
pub type Build<T> = fn(&[Assignment<'_>]) -> Built<T>;

/// Canonical text of a parameter after some assignments; `None` when there is no such parameter.
pub type Canonical = fn(&[Assignment<'_>], &str) -> Built<Option<String>>;

/// A row of a table of parts.
#[derive(Clone)]
pub struct Entry<F: Family> {
    /// Name.
    pub name: &'static str,
    /// Other names.
    pub aliases: &'static [&'static str],
    /// Groups that include it (`lk`, `gradient`, ...); none in families without.
    pub groups: &'static [&'static str],
    /// One-line description.
    pub summary: &'static str,
    /// Where the paper has it: algorithm or section. `None` for what is of this project, or of the original alone.
    pub published: Option<&'static str>,
    /// Parameters.
    pub params: fn() -> Vec<ParamInfo>,
    /// Canonical text of a parameter.
    pub canonical: Canonical,
    /// Builds it.
    pub build: F::Build,
    /// What only rows of this family say.
    pub family: F,
}

impl<F: Family> Entry<F> {
    /// A row without aliases and groups, with the parameters `P`.
    pub const fn new<P: Params>(
        name: &'static str,
        summary: &'static str,
        build: F::Build,
        family: F,
    ) -> Self {
        Entry {
            name,
            aliases: &[],
            groups: &[],
            summary,
            published: None,
            params: P::info,
            canonical: |assignments, name| Ok(P::from_assignments(assignments)?.get(name)),
            build,
            family,
        }
    }

    /// The row of part `M`.
    pub const fn of_part<M: Part>(build: F::Build, family: F) -> Self {
        Self::new::<M::Params>(M::NAME, M::SUMMARY, build, family).also(M::ALIASES)
    }

    /// The same with other names.
    pub const fn also(mut self, aliases: &'static [&'static str]) -> Self {
        self.aliases = aliases;
        self
    }

    /// The same in groups.
    pub const fn in_groups(mut self, groups: &'static [&'static str]) -> Self {
        self.groups = groups;
        self
    }

    /// The same with the algorithm or section of the paper that describes it.
    pub const fn published(mut self, place: &'static str) -> Self {
        self.published = Some(place);
        self
    }

    /// The same with values of parameters checked further.
    pub const fn checked(mut self, canonical: Canonical) -> Self {
        self.canonical = canonical;
        self
    }

    /// Whether `all` includes it.
    pub fn listed(&self) -> bool {
        !F::GROUPED || !self.groups.is_empty()
    }

    /// Whether `name` is its name or an alias.
    pub fn is_called(&self, name: &str) -> bool {
        self.name == name || self.aliases.contains(&name)
    }
}

/// Name of a part of family `F`: the parameter of a part that is made of others. Which names there are is known where it is
/// built ([`find`](Self::find)); the text may be any.
#[derive(Debug)]
pub struct NameOf<F>(String, PhantomData<fn() -> F>);

impl<F> Clone for NameOf<F> {
    fn clone(&self) -> Self {
        NameOf(self.0.clone(), PhantomData)
    }
}

impl<F> PartialEq for NameOf<F> {
    fn eq(&self, other: &Self) -> bool {
        self.0 == other.0
    }
}

impl<F: Family> NameOf<F> {
    /// The part of that name.
    pub fn new(name: &str) -> Self {
        NameOf(name.to_ascii_lowercase(), PhantomData)
    }

    /// The row it names, among those that can be part of others.
    ///
    /// # Errors
    /// None has that name. `parameter` is the one whose value the name is.
    pub fn find<'a>(&self, parameter: &'static str, known: &'a [Entry<F>]) -> Built<&'a Entry<F>> {
        let found = known.iter().find(|e| e.is_called(&self.0));
        found
            .filter(|e| !e.family.made_of_others())
            .ok_or_else(|| ParamError::Value {
                name: parameter,
                value: self.0.clone(),
                allowed: F::names_allowed(known),
            })
    }
}

impl<F: Family> ParamValue for NameOf<F> {
    const NAMES: Option<&'static str> = Some(F::ROLE);
    fn parse(text: &str) -> Option<Self> {
        (!text.is_empty()).then(|| Self::new(text))
    }
    fn text(&self) -> String {
        self.0.clone()
    }
    fn allowed() -> String {
        F::names_allowed(&[])
    }
}
