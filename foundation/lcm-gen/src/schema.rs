//! All definitions together: resolved names, fingerprints, sizes.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Definition, Error, File, Kind, Member, MemberType, Primitive, Size, fingerprint, parse};

/// Longest message that a receiver accepts (`lcm/lcm_udpm.c`: 2^28 bytes).
const MESSAGE_MAX: usize = 1 << 28;
/// Maximum nesting of types, each dimension of an array included: decoders recurse on the stack.
const NESTING_MAX: usize = 64;
/// Maximum number of steps for all fingerprints: mutually recursive types cost as many as there are paths through them.
const STEPS_MAX: u32 = 1 << 20;

/// Definitions in which every name is resolved and every type has a finite size.
#[derive(Clone, Debug, Default)]
pub struct Schema {
    definitions: Vec<Definition>,
    index: BTreeMap<String, usize>,
    packages: Vec<(String, Vec<String>)>,
    /// Definitions reachable from each definition's members.
    reach: Vec<BTreeSet<usize>>,
    min_sizes: Vec<usize>,
    fingerprints: Vec<u64>,
}

/// Intermediate results of [`Schema::full`].
#[derive(Default)]
struct Hashes {
    parents: Vec<usize>,
    known: BTreeMap<usize, u64>,
    steps: u32,
}

impl Schema {
    /// Parses all files together, given as name (for messages) and text.
    ///
    /// # Errors
    /// The first error in any of them, or between them.
    pub fn new(files: &[(impl AsRef<str>, impl AsRef<str>)]) -> Result<Self, Error> {
        let mut schema = Self::default();
        for (name, text) in files {
            schema.add(parse(name.as_ref(), text.as_ref())?)?;
        }
        schema.resolve()?;
        let mut depths = vec![None; schema.definitions.len()];
        (0..depths.len()).try_for_each(|i| schema.depth(i, 0, &mut depths).map(drop))?;
        schema.find_reach();
        schema.find_sizes()?;
        let mut hashes = Hashes::default();
        schema.fingerprints =
            (0..schema.definitions.len()).map(|i| schema.full(i, &mut hashes)).collect::<Result<_, _>>()?;
        Ok(schema)
    }

    /// All definitions, in order of the files and within them.
    #[must_use]
    pub fn definitions(&self) -> &[Definition] {
        &self.definitions
    }

    /// Comments before `package` lines of files with several types, with the packages' names, in order.
    #[must_use]
    pub fn packages(&self) -> &[(String, Vec<String>)] {
        &self.packages
    }

    /// Definition by its name with package.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Definition> {
        self.index.get(name).map(|&i| &self.definitions[i])
    }

    /// Fingerprint of a type, with which its messages begin.
    #[must_use]
    pub fn fingerprint(&self, name: &str) -> Option<u64> {
        self.index.get(name).map(|&i| self.fingerprints[i])
    }

    /// Hash shown by `lcm-gen -d`: the definition alone, without its compound members' types.
    #[must_use]
    pub fn base_hash(&self, name: &str) -> Option<u64> {
        self.get(name).map(fingerprint::base)
    }

    /// Minimum size of a value, without the fingerprint, bytes.
    #[must_use]
    pub fn min_size(&self, name: &str) -> Option<usize> {
        self.index.get(name).map(|&i| self.min_sizes[i])
    }

    /// True if all values have the same size: no strings and no variable arrays, at any depth.
    #[must_use]
    pub fn is_fixed(&self, name: &str) -> bool {
        let mut members = self.parts(name).flat_map(Definition::members);
        let known = self.index.contains_key(name);
        known && members.all(|member| !member.is_variable() && member.ty != MemberType::Primitive(Primitive::String))
    }

    /// Definition of this name, if there is one, and all reachable from it: everything needed to decode it.
    pub fn parts(&self, name: &str) -> impl Iterator<Item = &Definition> {
        let parts = self
            .index
            .get(name)
            .into_iter()
            .flat_map(|i| self.reach[*i].iter().filter(move |part| *part != i).chain([i]));
        parts.map(|&part| &self.definitions[part])
    }

    /// True if values of the type can contain values of the same type, at any depth.
    #[must_use]
    pub fn is_recursive(&self, name: &str) -> bool {
        self.index.get(name).is_some_and(|i| self.reach[*i].contains(i))
    }

    fn add(&mut self, file: File) -> Result<(), Error> {
        self.packages.extend(file.packages);
        for definition in file.definitions {
            let name = definition.name();
            if let Some(first) = self.get(&name) {
                let message = format!("`{name}` is already defined in {}:{}", first.file, first.at.line);
                return Err(Error::new(&definition.file, definition.at, message));
            }
            self.index.insert(name, self.definitions.len());
            self.definitions.push(definition);
        }
        Ok(())
    }

    fn resolve(&self) -> Result<(), Error> {
        for definition in &self.definitions {
            for member in definition.members() {
                let MemberType::Named(name) = &member.ty else {
                    continue;
                };
                let wrong = |message| Err(Error::new(&definition.file, member.at, message));
                match self.get(name).map(|definition| &definition.kind) {
                    None => return wrong(format!("type `{name}` is not defined{}", hint(name))),
                    Some(Kind::Enum { .. }) if !member.dims.is_empty() => {
                        return wrong(format!("`{name}` is an enum: arrays of enums are encoded differently by C"));
                    }
                    Some(_) => {}
                }
            }
        }
        Ok(())
    }

    /// Definition named by a member's type.
    fn target(&self, member: &Member) -> Option<usize> {
        match &member.ty {
            MemberType::Named(name) => self.index.get(name).copied(),
            MemberType::Primitive(_) => None,
        }
    }

    fn find_reach(&mut self) {
        let targets = |i: usize| self.definitions[i].members().iter().filter_map(|member| self.target(member));
        self.reach = (0..self.definitions.len())
            .map(|start| {
                let (mut reach, mut open) = (BTreeSet::new(), vec![start]);
                while let Some(next) = open.pop() {
                    open.extend(targets(next).filter(|&target| reach.insert(target)));
                }
                reach
            })
            .collect();
    }

    /// A type's fingerprint depends on its parents only if it leads back to one of them; all others are cached, because
    /// deep hierarchies would otherwise take exponential time.
    fn full(&self, i: usize, hashes: &mut Hashes) -> Result<u64, Error> {
        let definition = &self.definitions[i];
        if matches!(definition.kind, Kind::Enum { .. }) {
            return Ok(fingerprint::base(definition));
        }
        if hashes.parents.contains(&i) {
            return Ok(0);
        }
        let free = !hashes.parents.iter().any(|parent| self.reach[i].contains(parent));
        if let Some(&known) = hashes.known.get(&i).filter(|_| free) {
            return Ok(known);
        }
        hashes.steps += 1;
        if hashes.steps > STEPS_MAX || hashes.parents.len() > NESTING_MAX {
            let message = format!("`{}` is one of too many mutually recursive types", definition.name());
            return Err(Error::new(&definition.file, definition.at, message));
        }
        hashes.parents.push(i);
        let mut targets = definition.members().iter().filter_map(|member| self.target(member));
        let members = targets.try_fold(0_u64, |sum, target| Ok(sum.wrapping_add(self.full(target, hashes)?)))?;
        hashes.parents.pop();
        let full = fingerprint::full(fingerprint::base(definition), members);
        if free {
            hashes.known.insert(i, full);
        }
        Ok(full)
    }

    /// Number of levels of a type below `parents` others. A type that is already open counts as zero: decoding limits
    /// the depth of recursive values.
    fn depth(&self, i: usize, parents: usize, depths: &mut [Option<usize>]) -> Result<usize, Error> {
        if let Some(depth) = depths[i] {
            return Ok(depth);
        }
        depths[i] = Some(0);
        let (definition, mut depth) = (&self.definitions[i], 1);
        for member in definition.members() {
            let below = match self.target(member) {
                // No need to go deeper: with this many parents it is already too deep.
                Some(target) if parents < NESTING_MAX => self.depth(target, parents + 1, depths)?,
                Some(_) => NESTING_MAX,
                None => 0,
            };
            depth = depth.max(1 + member.dims.len() + below);
            if depth > NESTING_MAX {
                let message = format!("`{}` nests deeper than {NESTING_MAX} types and dimensions", member.name);
                return Err(Error::new(&definition.file, member.at, message));
            }
        }
        depths[i] = Some(depth);
        Ok(depth)
    }

    fn find_sizes(&mut self) -> Result<(), Error> {
        let mut sizes = vec![None; self.definitions.len()];
        for i in 0..sizes.len() {
            self.find_size(i, &mut Vec::new(), &mut sizes)?;
        }
        self.min_sizes = sizes.into_iter().flatten().collect();
        // For arrays that may be empty: one element must be receivable.
        for definition in &self.definitions {
            for member in definition.members().iter().filter(|member| member.is_variable()) {
                let element = match member.ty {
                    MemberType::Primitive(primitive) => primitive.min_size(),
                    MemberType::Named(_) => self.target(member).map_or(0, |target| self.min_sizes[target]),
                };
                if array_size(element, member) > MESSAGE_MAX {
                    return Err(too_large(definition, member));
                }
            }
        }
        Ok(())
    }

    fn find_size(&self, i: usize, parents: &mut Vec<usize>, sizes: &mut [Option<usize>]) -> Result<usize, Error> {
        let definition = &self.definitions[i];
        if let Some(size) = sizes[i] {
            return Ok(size);
        }
        if parents.contains(&i) {
            let message = format!("`{}` contains itself without end", definition.name());
            return Err(Error::new(&definition.file, definition.at, message));
        }
        parents.push(i);
        let mut size: usize = if matches!(definition.kind, Kind::Enum { .. }) { 4 } else { 0 };
        for member in definition.members().iter().filter(|member| !member.is_variable()) {
            let element = match (&member.ty, self.target(member)) {
                (MemberType::Primitive(primitive), _) => primitive.min_size(),
                (_, Some(target)) => self.find_size(target, parents, sizes)?,
                (_, None) => 0,
            };
            let total = array_size(element, member);
            size = size.saturating_add(if element == 0 && total <= MESSAGE_MAX { 0 } else { total });
            if size > MESSAGE_MAX {
                return Err(too_large(definition, member));
            }
        }
        parents.pop();
        sizes[i] = Some(size);
        Ok(size)
    }
}

/// What LCM has in place of the types of other languages.
fn hint(name: &str) -> &'static str {
    match name.rsplit('.').next().unwrap_or_default() {
        "uint8_t" => ": LCM has no unsigned integers, only `byte`",
        "uint16_t" | "uint32_t" | "uint64_t" => ": LCM has no unsigned integers, only `int8_t` to `int64_t` and `byte`",
        "bool" => ": the type is `boolean`",
        _ => "",
    }
}

/// Size of a member with elements of `element` bytes and variable dimensions of 1. An array of empty structs has no
/// bytes, but it takes time and memory in the decoder.
fn array_size(element: usize, member: &Member) -> usize {
    member.dims.iter().fold(element, |size, dim| match dim.size {
        Size::Fixed(n) => size.max(1).saturating_mul(n),
        Size::Variable => size,
    })
}

fn too_large(definition: &Definition, member: &Member) -> Error {
    let message = format!("`{}` makes messages of more than 2^28 bytes, the limit of receivers", member.name);
    Error::new(&definition.file, member.at, message)
}
