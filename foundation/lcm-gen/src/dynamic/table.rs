//! Definitions prepared for decoding: sizes computed, names resolved to indices.

use std::collections::BTreeMap;

use crate::{Definition, Kind, Member, MemberType, Primitive, Schema, Size};

/// Struct, or an enum, which has no fields.
#[derive(Clone, Debug)]
pub struct Struct {
    pub name: String,
    pub fingerprint: u64,
    /// Size of each value, if constant.
    pub fixed: Option<usize>,
    /// Number of fields that are lengths.
    pub slots: usize,
    pub fields: Vec<Field>,
    /// Values of an enum.
    pub values: Option<Vec<(String, i32)>>,
    /// Minimum number of elements without bytes in a value.
    pub empties: usize,
}

#[derive(Clone, Debug)]
pub struct Field {
    pub name: String,
    pub element: Element,
    pub dims: Vec<Len>,
    /// Slot of its value, if the field is a length.
    pub slot: Option<usize>,
    /// True for a length that is the outermost dimension of an array, and is not shown.
    pub implicit: bool,
    /// Size of each element, if constant.
    pub fixed: Option<usize>,
    /// Minimum size of an element, bytes.
    pub min: usize,
    /// True if elements count for the nesting depth.
    pub recursive: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    Primitive(Primitive),
    /// Index of a [`Struct`] in the table.
    Struct(usize),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Len {
    Fixed(usize),
    /// Value of the length field with this slot.
    Slot(usize),
}

/// All definitions of the schema, in order.
pub fn table(schema: &Schema) -> Vec<Struct> {
    let places = schema.definitions().iter().enumerate().map(|(i, definition)| (definition.name(), i)).collect();
    let mut structs: Vec<Struct> =
        schema.definitions().iter().map(|definition| of(schema, &places, definition)).collect();
    for i in 0..structs.len() {
        count_empties(&mut structs, i);
    }
    structs
}

fn of(schema: &Schema, places: &BTreeMap<String, usize>, definition: &Definition) -> Struct {
    let name = definition.name();
    let members = definition.members();
    let mut lengths: Vec<&str> = Vec::new();
    for dim in members.iter().flat_map(|member| &member.dims).filter(|dim| dim.size == Size::Variable) {
        if !lengths.contains(&dim.text.as_str()) {
            lengths.push(&dim.text);
        }
    }
    let slot = |name: &str| lengths.iter().position(|length| *length == name);
    let field = |member: &Member| {
        let (element, fixed, min, recursive) = match &member.ty {
            MemberType::Primitive(Primitive::String) => (Element::Primitive(Primitive::String), None, 5, false),
            MemberType::Primitive(ty) => (Element::Primitive(*ty), Some(ty.min_size()), ty.min_size(), false),
            MemberType::Named(name) => {
                let place = places.get(name).copied();
                let min = schema.min_size(name).unwrap_or_default();
                let fixed = schema.is_fixed(name).then_some(min);
                // The schema has resolved every name.
                (Element::Struct(place.unwrap_or_default()), fixed, min, schema.is_recursive(name))
            }
        };
        let dims = member.dims.iter().map(|dim| match dim.size {
            Size::Fixed(count) => Len::Fixed(count),
            Size::Variable => Len::Slot(slot(&dim.text).unwrap_or_default()),
        });
        let outermost = |other: &Member| {
            other.dims.first().is_some_and(|dim| dim.size == Size::Variable && dim.text == member.name)
        };
        Field {
            name: member.name.clone(),
            element,
            dims: dims.collect(),
            slot: slot(&member.name),
            implicit: members.iter().any(outermost),
            fixed,
            min,
            recursive,
        }
    };
    let min = schema.min_size(&name).unwrap_or_default();
    Struct {
        fingerprint: schema.fingerprint(&name).unwrap_or_default(),
        fixed: schema.is_fixed(&name).then_some(min),
        slots: lengths.len(),
        fields: members.iter().map(field).collect(),
        values: match &definition.kind {
            Kind::Enum { values } => Some(values.iter().map(|value| (value.name.clone(), value.number)).collect()),
            Kind::Struct { .. } => None,
        },
        empties: usize::MAX,
        name,
    }
}

/// Terminates: types contain themselves in variable arrays only.
fn count_empties(structs: &mut [Struct], i: usize) -> usize {
    if structs[i].empties != usize::MAX {
        return structs[i].empties;
    }
    let mut sum = 0_usize;
    for f in 0..structs[i].fields.len() {
        let field = &structs[i].fields[f];
        let (element, own) = (field.element, usize::from(field.fixed == Some(0)));
        let fixed = field.dims.iter().try_fold(1_usize, |product, len| match len {
            Len::Fixed(count) => Some(product.saturating_mul(*count)),
            Len::Slot(_) => None,
        });
        if let (Some(count), Element::Struct(place)) = (fixed, element) {
            let each = count_empties(structs, place).saturating_add(own);
            sum = sum.saturating_add(count.saturating_mul(each));
        }
    }
    structs[i].empties = sum.min(usize::MAX - 1);
    sum
}
