//! Steps of the conversion of a type.

use crate::dynamic::table::{Element, Field, Len, Struct, table};
use crate::{Primitive, Schema};

/// Struct or enum.
#[derive(Clone, Debug)]
pub struct Body {
    pub fingerprint: u64,
    /// Number of its members that are lengths.
    pub slots: usize,
    /// Minimum number of elements without bytes in a value.
    pub empties: usize,
    /// Maximum number of lengths in scope while it is read; `None` for a recursive type.
    pub lengths: Option<usize>,
    pub steps: Vec<Step>,
}

#[derive(Clone, Debug)]
pub enum Step {
    /// Consecutive numbers of equal width.
    Numbers { width: usize, count: usize },
    /// Consecutive booleans.
    Booleans { count: usize },
    /// Length of later arrays, itself a number.
    Length { slot: usize, ty: Primitive },
    /// Any other array.
    Array(Array),
    /// Placeholder of ROS 2 in a struct without members.
    Nothing,
}

#[derive(Clone, Debug)]
pub struct Array {
    pub element: Item,
    pub dims: Vec<Len>,
    /// Size of each element, if constant.
    pub fixed: Option<usize>,
    /// Minimum size of an element, bytes.
    pub min: usize,
}

#[derive(Clone, Copy, Debug)]
pub enum Item {
    Number {
        width: usize,
    },
    Boolean,
    String,
    /// Index of a [`Body`].
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
    // A type with an unknown number of lengths is recursive, and so are all types that contain it.
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

/// Consecutive numbers of one width without a gap form one step.
fn push(steps: &mut Vec<Step>, step: Step) {
    match (steps.last_mut(), step) {
        (Some(Step::Numbers { width, count }), Step::Numbers { width: same, count: more }) if *width == same => {
            *count += more;
        }
        (Some(Step::Booleans { count }), Step::Booleans { count: more }) => *count += more,
        (_, step) => steps.push(step),
    }
}

/// Visits each type once; a type that is still being visited is recursive.
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
    /// Number of elements, if it does not depend on the message.
    fn fixed_count(&self) -> Option<usize> {
        self.dims.iter().try_fold(1_usize, |product, len| match len {
            Len::Fixed(count) => Some(product.saturating_mul(*count)),
            Len::Slot(_) => None,
        })
    }

    /// True if ROS 2 has a sequence here: elements preceded by their number.
    pub fn is_sequence(&self) -> bool {
        self.dims.iter().any(|len| matches!(len, Len::Slot(_)))
    }
}
