//! What is to be done with the bytes of a type, step by step.

use crate::dynamic::table::{Element, Field, Len, Struct, table};
use crate::{Primitive, Schema};

/// A struct or an enum.
#[derive(Clone, Debug)]
pub struct Body {
    pub fingerprint: u64,
    /// How many of its members are lengths.
    pub slots: usize,
    /// Number of elements without bytes each value shows, at least.
    pub empties: usize,
    /// How many lengths are in force at most while it is read; `None`: it holds itself.
    pub lengths: Option<usize>,
    pub steps: Vec<Step>,
}

#[derive(Clone, Debug)]
pub enum Step {
    /// So many numbers of so many bytes each, in a row.
    Numbers { width: usize, count: usize },
    /// So many truth values.
    Booleans { count: usize },
    /// A length of arrays to come, itself a number.
    Length { slot: usize, ty: Primitive },
    /// Anything else.
    Array(Array),
    /// What ROS 2 puts into a struct without members.
    Nothing,
}

#[derive(Clone, Debug)]
pub struct Array {
    pub element: Item,
    pub dims: Vec<Len>,
    /// The size of every element, where all have the same.
    pub fixed: Option<usize>,
    /// Fewest bytes of an element.
    pub min: usize,
}

#[derive(Clone, Copy, Debug)]
pub enum Item {
    Number {
        width: usize,
    },
    Boolean,
    String,
    /// The place of a [`Body`].
    Struct(usize),
}

/// All definitions of the schema, in order.
pub fn bodies(schema: &Schema) -> Vec<Body> {
    let table = table(schema);
    let mut bodies: Vec<Body> = table.iter().map(body).collect();
    let mut seen = vec![false; bodies.len()];
    for i in 0..bodies.len() {
        find_lengths(&mut bodies, i, &mut seen);
    }
    // Whose lengths are unknown holds itself, and so do all that lead to it.
    bodies
}

fn body(ty: &Struct) -> Body {
    let mut steps = Vec::new();
    for field in &ty.fields {
        push(&mut steps, step(field));
    }
    if ty.values.is_some() {
        steps.push(Step::Numbers { width: 4, count: 1 });
    } else if ty.fields.is_empty() {
        steps.push(Step::Nothing);
    }
    Body { fingerprint: ty.fingerprint, slots: ty.slots, empties: ty.empties, lengths: None, steps }
}

fn step(field: &Field) -> Step {
    if let (Some(slot), Element::Primitive(ty)) = (field.slot, field.element) {
        return Step::Length { slot, ty };
    }
    let element = match field.element {
        Element::Struct(place) => Item::Struct(place),
        Element::Primitive(Primitive::String) => Item::String,
        Element::Primitive(Primitive::Boolean) => Item::Boolean,
        Element::Primitive(ty) => Item::Number { width: ty.min_size() },
    };
    let array = Array { element, dims: field.dims.clone(), fixed: field.fixed, min: field.min };
    match (array.fixed_count(), element) {
        (Some(count), Item::Number { width }) => Step::Numbers { width, count },
        (Some(count), Item::Boolean) => Step::Booleans { count },
        _ => Step::Array(array),
    }
}

/// Numbers of one size follow each other without a gap: one step.
fn push(steps: &mut Vec<Step>, step: Step) {
    match (steps.last_mut(), step) {
        (Some(Step::Numbers { width, count }), Step::Numbers { width: same, count: more }) if *width == same => {
            *count += more;
        }
        (Some(Step::Booleans { count }), Step::Booleans { count: more }) => *count += more,
        (_, step) => steps.push(step),
    }
}

/// Each type once, however many ways lead to it; one that is open already holds itself.
fn find_lengths(bodies: &mut [Body], i: usize, seen: &mut [bool]) -> Option<usize> {
    if seen[i] {
        return bodies[i].lengths;
    }
    seen[i] = true;
    let places = bodies[i].steps.iter().filter_map(|step| match step {
        Step::Array(Array { element: Item::Struct(place), .. }) => Some(*place),
        _ => None,
    });
    let places: Vec<usize> = places.collect();
    let mut deepest = 0;
    for place in places {
        deepest = deepest.max(find_lengths(bodies, place, seen)?);
    }
    bodies[i].lengths = Some(bodies[i].slots + deepest);
    bodies[i].lengths
}

impl Array {
    /// Number of elements there are, where no message says it.
    fn fixed_count(&self) -> Option<usize> {
        self.dims.iter().try_fold(1_usize, |product, len| match len {
            Len::Fixed(count) => Some(product.saturating_mul(*count)),
            Len::Slot(_) => None,
        })
    }

    /// True if ROS 2 has a sequence here: elements behind their number.
    pub fn is_sequence(&self) -> bool {
        self.dims.iter().any(|len| matches!(len, Len::Slot(_)))
    }
}
