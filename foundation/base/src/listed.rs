//! Enums with a list of their values.

/// Declares an enum of names or numbers, and `ALL`: its values in the order of their declaration. No value can be
/// missing from it. With a text behind each value, also `name()`, which returns that text, and `Display`, which prints
/// it; such an enum is `Copy`.
///
/// ```
/// base::listed! {
///     /// Answer of a switch.
///     #[derive(Clone, Copy, Debug, PartialEq)]
///     pub enum Answer {
///         /// Open.
///         Open = 1,
///         /// Closed.
///         Closed = 4,
///     }
/// }
///
/// assert_eq!(Answer::ALL, [Answer::Open, Answer::Closed]);
///
/// base::listed! {
///     /// Direction of a switch.
///     #[derive(Clone, Copy)]
///     pub enum Direction {
///         /// To the rear.
///         Back = -1 => "backward",
///         /// To the front.
///         Front = 1 => "forward",
///     }
/// }
///
/// assert_eq!(Direction::ALL.map(Direction::name), ["backward", "forward"]);
/// assert_eq!(Direction::Front.to_string(), "forward");
/// ```
#[macro_export]
macro_rules! listed {
    ($(#[$attribute:meta])* $visibility:vis enum $name:ident {
        $($(#[$comment:meta])* $value:ident $(= $number:literal)?),+ $(,)?
    }) => {
        $(#[$attribute])*
        $visibility enum $name {
            $($(#[$comment])* $value $(= $number)?,)+
        }

        impl $name {
            /// All values, in the order of their declaration.
            pub const ALL: [$name; [$($name::$value),+].len()] = [$($name::$value),+];
        }
    };
    ($(#[$attribute:meta])* $visibility:vis enum $name:ident {
        $($(#[$comment:meta])* $value:ident $(= $number:expr)? => $text:expr),+ $(,)?
    }) => {
        $(#[$attribute])*
        $visibility enum $name {
            $($(#[$comment])* $value $(= $number)?,)+
        }

        #[allow(dead_code, reason = "an enum may need its list or its names alone")]
        impl $name {
            /// All values, in the order of their declaration.
            pub const ALL: [$name; [$($name::$value),+].len()] = [$($name::$value),+];

            /// Name or text of the value, as [`Display`](core::fmt::Display) prints it.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $text,)+
                }
            }
        }

        impl ::core::fmt::Display for $name {
            fn fmt(&self, f: &mut ::core::fmt::Formatter<'_>) -> ::core::fmt::Result {
                f.pad(self.name())
            }
        }
    };
}
