//! Generated LCM codecs, compared with the official ones' rules.

use lcm::codec::{Type, View};
use std::fmt::Debug;

#[path = "../../foundation/lcm-gen/tests/vectors/generated.rs"]
#[allow(dead_code)]
mod vectors;

#[path = "../../foundation/lcm-gen/tests/more/generated.rs"]
#[allow(dead_code)]
mod own;

use own::more;
use vectors::{NopkgRef, advee, vec};

/// The fingerprint is right, or nothing behind it would ever be reached.
fn message<T: Type>(body: &[u8]) -> Vec<u8> {
    [&T::FINGERPRINT.to_be_bytes(), body].concat()
}

fn owned<T: Type + Debug>(message: &[u8]) -> Result<T, lcm::codec::DecodeError> {
    let value = T::decode(message);
    if let Ok(value) = &value {
        let mut again = Vec::new();
        value.encode(&mut again).expect("what was decoded can be encoded");
        // A boolean may come as any byte that is not zero, and leaves as one.
        assert_eq!((again.len(), value.encoded_size()), (message.len(), message.len()));
        let mut slice = vec![0xA5; message.len()];
        assert_eq!(value.encode_into(&mut slice), Ok(slice.len()));
        assert_eq!(slice, again);
    }
    value
}

fn both<'a, V: View<'a, Of: Debug> + Debug>(message: &'a [u8]) {
    match (owned::<V::Of>(message), V::decode(message)) {
        (Ok(value), Ok(view)) => {
            assert_eq!(format!("{value:?}").replace("Self_ {", "Self {"), format!("{view:?}").replace("Ref {", " {"));
        }
        (value, view) => assert_eq!(value.err(), view.err()),
    }
}

/// A payload of one of the generator's sample types; the first byte selects the type.
///
/// What decodes encodes to the same number of bytes, and a view of it reads or refuses the same.
pub fn lcm_codec(data: &[u8]) {
    let Some(input) = crate::input::<(u8, &[u8])>(data) else { return };
    macro_rules! types {
        ($($at:literal $kind:ident $type:ty;)*) => {
            match input.0 % 18 {
                $($at => { types!($kind $type); })*
                _ => unreachable!("less than 18"),
            }
        };
        (view $type:ty) => { both::<$type>(&message::<<$type as View>::Of>(input.1)) };
        (only $type:ty) => { let _ = owned::<$type>(&message::<$type>(input.1)); };
    }
    types! {
        0 view advee::RangeScanRef<'_>;
        1 view NopkgRef<'_>;
        2 view vec::ArraysRef<'_>;
        3 view vec::deep::er::WrapperRef<'_>;
        4 view vec::NestedRef<'_>;
        5 view vec::PrimitivesRef<'_>;
        6 view vec::TreeRef<'_>;
        7 view more::ItemRef<'_>;
        8 view more::LargeRef<'_>;
        9 view more::LengthsRef<'_>;
        10 view more::r#mod::r#type::SelfRef<'_>;
        11 view more::r#mod::r#type::StringRef<'_>;
        12 only vec::Ping;
        13 only vec::EnumUser;
        14 only vec::SeveralB;
        15 only vec::other::SeveralC;
        16 only more::LargeFixed;
        17 only vec::Constants;
    }
}
