//! The options of a method, described once; bindings, tests and documentation read the description.

use crate::error::{Error, Result, shown};

/// The value of an option of any type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// An optional number that is not set.
    None,
    /// A truth value.
    Flag(bool),
    /// A whole number.
    Whole(u64),
    /// A number.
    Number(f64),
    /// One of a few words.
    Word(&'static str),
    /// All numbers from the first to the second.
    Range(f64, f64),
}

/// Type and range of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// True or false.
    Flag,
    /// A seed of random numbers.
    Seed,
    /// A whole number.
    Count {
        /// The least value.
        least: u64,
        /// The greatest value.
        most: u64,
    },
    /// A number of iterations, each of which takes time.
    Rounds {
        /// The least value.
        least: u64,
    },
    /// A length in the unit of the data: finite and greater than 0.
    Length,
    /// A number.
    Number {
        /// The least value.
        least: f64,
        /// The greatest value.
        most: f64,
        /// Remedy in the error message for a value out of range.
        remedy: &'static str,
    },
    /// One of a few words or numbers.
    Choice(&'static [Value]),
    /// A threshold of scores: the word "otsu", or a number.
    Cut,
    /// Whether the scale is unknown, or its positive bounds.
    Scale,
}

/// A fraction between 0 and 1.
pub const SHARE: Kind = number(0.0, 1.0, "give a number between 0 and 1");

/// A number from 0 to less than 1.
pub const BELOW_ONE: Kind = number(0.0, 1.0_f64.next_down(), "give a number from 0 to less than 1");

/// A finite number greater than 0 that is not a length.
pub const POSITIVE: Kind = number(0.0_f64.next_up(), f64::MAX, "give a finite number greater than 0");

/// A count with a lower bound.
pub const fn at_least(least: u64) -> Kind {
    Kind::Count { least, most: u64::MAX }
}

/// A number of iterations, at least one.
pub const ROUNDS: Kind = Kind::Rounds { least: 1 };

/// A count from 1 to an upper bound.
pub const fn at_most(most: u64) -> Kind {
    Kind::Count { least: 1, most }
}

/// A number between two bounds.
pub const fn number(least: f64, most: f64, remedy: &'static str) -> Kind {
    Kind::Number { least, most, remedy }
}

/// The description of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OptionInfo {
    /// Its public name.
    pub name: &'static str,
    /// Its type and range.
    pub kind: Kind,
    /// Whether it may be unset.
    pub optional: bool,
    /// Its documentation in Markdown; each line keeps the leading space of its comment.
    pub text: &'static str,
}

impl OptionInfo {
    /// Checks that a value of the correct type lies in the option's range.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] otherwise.
    pub fn check(&self, value: Value) -> Result<()> {
        let refused = |got: String, remedy: String| Err(Error::invalid(self.name, got, remedy));
        match (self.kind, value) {
            (Kind::Count { least, .. } | Kind::Rounds { least }, Value::Whole(count)) if count < least => {
                refused(count.to_string(), format!("give a whole number of at least {least}"))
            }
            (Kind::Count { most, .. }, Value::Whole(count)) if count > most => {
                refused(count.to_string(), format!("give a whole number of at most {}", grouped(most)))
            }
            (Kind::Length, Value::Number(length)) if !(length.is_finite() && length > 0.0) => {
                refused(shown(length), "give a finite number greater than 0".into())
            }
            (Kind::Number { least, most, remedy }, Value::Number(number))
                if !(least..=most).contains(&number) =>
            {
                refused(shown(number), remedy.into())
            }
            (Kind::Cut, Value::Number(number)) if number.is_nan() => {
                refused(shown(number), "give a number or \"otsu\"".into())
            }
            (Kind::Scale, Value::Range(low, high)) if !(0.0 <= low && low <= high && high > 0.0) => {
                refused(format!("({}, {})", shown(low), shown(high)), "give the least scale first".into())
            }
            _ => Ok(()),
        }
    }
}

/// A whole number with commas between thousands.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let (first, rest) = digits.split_at((digits.len() - 1) % 3 + 1);
    rest.as_bytes()
        .chunks(3)
        .fold(first.to_owned(), |text, group| text + "," + &String::from_utf8_lossy(group))
}

/// The description of a method and access to its options; implemented by `method!`.
pub trait Described {
    /// The public name.
    fn name(&self) -> &'static str;

    /// Fields of the correspondences that the method requires.
    fn fields(&self) -> &'static [&'static str];

    /// Fields that it uses if present, by default or with some of its options.
    fn optional_fields(&self) -> &'static [&'static str];

    /// Its options in their order.
    fn options(&self) -> &'static [OptionInfo];

    /// Value of the option with that name; `None` if there is none.
    fn get(&self, name: &str) -> Option<Value>;

    /// Sets the option with that name; returns whether it exists and accepts the value.
    fn set(&mut self, name: &str, value: Value) -> bool;

    /// Checks the range of every option.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for the first value out of range.
    fn check_options(&self) -> Result<()> {
        self.options().iter().try_for_each(|option| self.get(option.name).map_or(Ok(()), |v| option.check(v)))
    }
}

/// A type of options.
pub trait OptionType: Copy {
    /// Kind of an option of this type unless its description sets another.
    const KIND: Kind;

    /// Whether values may be unset.
    const OPTIONAL: bool = false;

    /// Converts a value to this type, if possible.
    fn read(value: Value) -> Option<Self>;

    /// Converts to a value.
    fn value(self) -> Value;
}

impl OptionType for bool {
    const KIND: Kind = Kind::Flag;

    fn read(value: Value) -> Option<Self> {
        if let Value::Flag(flag) = value { Some(flag) } else { None }
    }

    fn value(self) -> Value {
        Value::Flag(self)
    }
}

impl OptionType for u64 {
    const KIND: Kind = Kind::Seed;

    fn read(value: Value) -> Option<Self> {
        if let Value::Whole(number) = value { Some(number) } else { None }
    }

    fn value(self) -> Value {
        Value::Whole(self)
    }
}

impl OptionType for usize {
    const KIND: Kind = at_least(1);

    fn read(value: Value) -> Option<Self> {
        u64::read(value).map(|number| number as Self)
    }

    fn value(self) -> Value {
        Value::Whole(self as u64)
    }
}

impl OptionType for f64 {
    const KIND: Kind = Kind::Length;

    fn read(value: Value) -> Option<Self> {
        if let Value::Number(number) = value { Some(number) } else { None }
    }

    fn value(self) -> Value {
        Value::Number(self)
    }
}

impl<T: OptionType> OptionType for Option<T> {
    const KIND: Kind = T::KIND;
    const OPTIONAL: bool = true;

    fn read(value: Value) -> Option<Self> {
        if value == Value::None { Some(None) } else { T::read(value).map(Some) }
    }

    fn value(self) -> Value {
        self.map_or(Value::None, T::value)
    }
}

/// Defines an enum whose variants are option words; the first is the default.
macro_rules! words {
    (
        $(#[$meta:meta])*
        pub enum $Name:ident {
            $( $(#[$doc:meta])* $Variant:ident = $value:expr, )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $Name {
            $( $(#[$doc])* $Variant, )*
        }

        impl $Name {
            const ALL: &'static [Self] = &[$( Self::$Variant, )*];
        }

        impl Default for $Name {
            fn default() -> Self {
                Self::ALL[0]
            }
        }

        impl $crate::options::OptionType for $Name {
            const KIND: $crate::options::Kind = $crate::options::Kind::Choice(&[$( $value, )*]);

            fn read(value: $crate::options::Value) -> Option<Self> {
                Self::ALL.iter().copied().find(|known| known.value() == value)
            }

            fn value(self) -> $crate::options::Value {
                match self {
                    $( Self::$Variant => $value, )*
                }
            }
        }
    };
}
pub(crate) use words;

/// Defines the parameters of a method: each with its documentation, type, default and kind.
macro_rules! method {
    (
        $(#[$meta:meta])*
        pub struct $Method:ident = $name:literal, $fields:expr, optional $optional:expr, {
            $( $(#[doc = $doc:literal])* pub $option:ident: $type:ty = $default:expr $(, $kind:expr)?; )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $Method {
            $( $(#[doc = $doc])* pub $option: $type, )*
        }

        impl Default for $Method {
            fn default() -> Self {
                Self { $( $option: $default, )* }
            }
        }

        impl $crate::options::Described for $Method {
            fn name(&self) -> &'static str {
                $name
            }

            fn fields(&self) -> &'static [&'static str] {
                &$fields
            }

            fn optional_fields(&self) -> &'static [&'static str] {
                &$optional
            }

            fn options(&self) -> &'static [$crate::options::OptionInfo] {
                const {
                    &[$( $crate::options::OptionInfo {
                        name: stringify!($option),
                        kind: [$( $kind, )? <$type as $crate::options::OptionType>::KIND][0],
                        optional: <$type as $crate::options::OptionType>::OPTIONAL,
                        text: concat!($( $doc, )*),
                    }, )*]
                }
            }

            fn get(&self, name: &str) -> Option<$crate::options::Value> {
                match name {
                    $( stringify!($option) => Some($crate::options::OptionType::value(self.$option)), )*
                    _ => None,
                }
            }

            fn set(&mut self, name: &str, value: $crate::options::Value) -> bool {
                match name {
                    $( stringify!($option) => {
                        $crate::options::OptionType::read(value).map(|value| self.$option = value).is_some()
                    } )*
                    _ => false,
                }
            }
        }
    };
}
pub(crate) use method;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::methods;

    #[test]
    fn thousands_are_separated() {
        let numbers = [7, 100, 1_000, 12_345, 1_000_000].map(grouped);
        assert_eq!(numbers, ["7", "100", "1,000", "12,345", "1,000,000"]);
    }

    #[test]
    fn every_option_accepts_its_own_type_only() {
        for (name, mut method) in methods() {
            for option in method.options() {
                let value = method.get(option.name).unwrap_or(Value::None);
                assert!(method.set(option.name, value), "{name}: {}", option.name);
                assert_eq!(method.set(option.name, Value::None), option.optional, "{name}: {}", option.name);
                assert!(!method.set(option.name, Value::Word("nonsense")), "{name}: {}", option.name);
            }
            assert!(!method.set("nonsense", Value::Flag(true)) && method.get("nonsense").is_none());
            assert!(method.check_options().is_ok(), "{name}");
        }
    }

    #[test]
    fn the_ends_of_a_range_belong_to_it() {
        let of = |kind| OptionInfo { name: "share", kind, optional: false, text: "" };
        for (value, accepted) in [(0.0, true), (1.0, true), (-1e-9, false), (1.1, false), (f64::NAN, false)] {
            assert_eq!(of(SHARE).check(Value::Number(value)).is_ok(), accepted, "{value}");
        }
        for (value, accepted) in [(0, false), (1, true), (9, true), (10, false)] {
            assert_eq!(of(at_most(9)).check(Value::Whole(value)).is_ok(), accepted, "{value}");
        }
    }
}
