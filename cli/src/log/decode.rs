//! Decoding of a log's messages by the types stored in the log, else by those known here.

use super::source::Item;
use crate::Failed;
use crate::lcm::types::{Dictionary, Found, TypesArg};
use lcm_gen::Schema;
use lcm_gen::dynamic::{Message, Types};
use std::collections::BTreeMap;
use std::sync::Arc;

pub struct Decoder {
    known: Arc<Dictionary>,
    /// Types stored in the log, by channel; `None` if they cannot be read.
    own: BTreeMap<(usize, u16), Option<Types>>,
}

impl Decoder {
    pub fn new(types: &TypesArg) -> Result<Self, Failed> {
        Ok(Self { known: Arc::new(Dictionary::load(types)?), own: BTreeMap::new() })
    }

    /// Another one with the same types, for another thread.
    pub fn another(&self) -> Self {
        Self { known: self.known.clone(), own: BTreeMap::new() }
    }

    /// Decodes a message.
    pub fn decode<'a>(&'a mut self, item: &Item<'a>) -> Result<Message<'a>, String> {
        if item.encoding != "lcm" {
            let encoding = if item.encoding.is_empty() { "unknown encoding" } else { item.encoding };
            return Err(format!("{} bytes of {encoding}, which is not decoded", item.data.len()));
        }
        if let Some(schema) = item.schema {
            let own = self.own.entry(item.key).or_insert_with(|| {
                // Logs of others may have it as a schema.
                let schema_text = || str::from_utf8(&schema.data).ok().filter(|_| schema.encoding == "lcm");
                let text = item.metadata.get(logger::TYPES).map(String::as_str).or_else(schema_text)?;
                Schema::new(&[(schema.name.as_str(), text)]).ok().map(|schema| Types::new(&schema))
            });
            if let Some(types) = own.as_ref() {
                // The first type with this fingerprint is nearly always the one of this name.
                if let Some(Ok(message)) = types.decode(item.data).filter(|message| is(message, &schema.name)) {
                    return Ok(message);
                }
                if let Some(Ok(message)) = types.get(&schema.name).map(|ty| ty.decode(item.data)) {
                    return Ok(message);
                }
            }
        }
        match self.known.find(item.channel, item.data) {
            Found::Message(message) | Found::Misplaced(message, _) => Ok(message),
            other => Err(format!("{} bytes, {other}", item.data.len())),
        }
    }
}

fn is<E>(message: &Result<Message<'_>, E>, name: &str) -> bool {
    message.as_ref().is_ok_and(|message| message.ty().name() == name)
}
