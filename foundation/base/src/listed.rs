//! Enums with a list of their values.

/// Declares an enum of names or numbers, and `ALL`: its values in the order of their declaration. No value can be
/// missing from it.
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
}
