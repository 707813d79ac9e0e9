//! Messages decoded by their definition, compared with the generated code.

use lcm_gen::Schema;
use lcm_gen::dynamic::{Missing, Types};
use messages::{Channel, Message};
use std::sync::LazyLock;

static TYPES: LazyLock<Types> =
    LazyLock::new(|| Types::new(&Schema::new(messages::LCM_FILES).expect("they are built in")));

/// A message of one of the robot's types, decoded by its definition; the first byte selects the channel.
///
/// It is refused, printed and encoded as by the generated code.
pub fn lcm_dynamic(data: &[u8]) {
    let Some(input) = crate::input::<(u8, &[u8])>(data) else { return };
    let channel = Channel::ALL[usize::from(input.0) % Channel::ALL.len()];
    // The fingerprint is right, or nothing behind it would ever be reached.
    let mut bytes = channel.fingerprint().to_be_bytes().to_vec();
    bytes.extend(input.1);
    let ty = TYPES.get(channel.type_name()).expect("the channel's type is among them");
    let (dynamic, generated) = (ty.decode(&bytes), Message::decode(channel, &bytes));
    match (dynamic, generated) {
        (Ok(dynamic), Ok(generated)) => {
            let (mut ours, mut theirs) = (Vec::new(), Vec::new());
            ty.encode(&dynamic.value(), Missing::Refuse, &mut ours).expect("what was decoded can be encoded");
            generated.encode(&mut theirs).expect("what was decoded can be encoded");
            assert_eq!(ours, theirs);
            // Derived code has null for infinities.
            let json = |value: serde_json::Result<String>| {
                value.expect("JSON can say it").replace("\"-inf\"", "null").replace("\"inf\"", "null")
            };
            assert_eq!(json(serde_json::to_string(&dynamic)), json(serde_json::to_string(&generated)));
        }
        (Err(ours), Err(theirs)) => assert_eq!(ours.to_string(), theirs.to_string()),
        (ours, theirs) => panic!("{ours:?}, generated: {theirs:?}"),
    }
    // Whatever stands in front.
    let _ = TYPES.decode(input.1).and_then(Result::ok).map(|message| message.value());
}
