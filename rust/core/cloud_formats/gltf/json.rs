//! JSON, whose strings are borrowed from the text. Objects and lists may be nested 127 deep.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::HashMap;
use std::fmt;

use serde_core::de::{DeserializeSeed, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};

use super::super::lines::shown;
use crate::error::Error;
use crate::execution::Execution;
use crate::memory;

/// A value.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Json<'a> {
    Null,
    Flag(bool),
    Whole(i64),
    Real(f64),
    Text(Cow<'a, str>),
    List(Vec<Self>),
    Object(HashMap<Cow<'a, str>, Self>),
}

/// Parses a text.
///
/// # Errors
/// [`Error::InvalidInput`] for a text that is not JSON, [`Error::OutOfMemory`], [`Error::Interrupted`].
pub(super) fn parse<'a>(text: &'a [u8], execution: &Execution) -> Result<Json<'a>, Error> {
    let failure = Cell::new(None);
    let reader = Reader { failure: &failure, execution };
    let mut source = serde_json::Deserializer::from_slice(text);
    let parsed = reader.deserialize(&mut source).and_then(|value| source.end().map(|()| value));
    parsed.map_err(|fault| {
        failure.take().unwrap_or_else(|| Error::invalid("JSON", "a fault", fault.to_string()))
    })
}

/// Copies a string.
pub(super) fn copied(text: &str) -> Result<String, Error> {
    let mut copy = String::new();
    copy.try_reserve_exact(text.len()).map_err(|_| Error::OutOfMemory { bytes: text.len() })?;
    copy.push_str(text);
    Ok(copy)
}

impl Json<'_> {
    /// The value of a key; `None` if it is missing or null.
    pub fn get(&self, key: &str) -> Result<Option<&Self>, Error> {
        let Self::Object(entries) = self else {
            return Err(Error::invalid("JSON", self, format!("an object with {key} belongs there")));
        };
        Ok(entries.get(key).filter(|value| !matches!(value, Self::Null)))
    }

    /// The value of a key that has to be there.
    pub fn need(&self, key: &str) -> Result<&Self, Error> {
        self.get(key)?.ok_or_else(|| Error::invalid(key, "nothing", "the file lacks it"))
    }

    /// The list of a key, empty if it is missing.
    pub fn list(&self, key: &str) -> Result<&[Self], Error> {
        match self.get(key)? {
            None => Ok(&[]),
            Some(Self::List(items)) => Ok(items),
            Some(other) => Err(Error::invalid(key, other, "a list belongs there")),
        }
    }

    /// The count of a key.
    pub fn count(&self, key: &str) -> Result<Option<usize>, Error> {
        self.get(key)?.map(|value| value.as_count(key)).transpose()
    }

    /// The count of a key that has to be there.
    pub fn needed_count(&self, key: &str) -> Result<usize, Error> {
        self.need(key)?.as_count(key)
    }

    fn as_count(&self, key: &str) -> Result<usize, Error> {
        let count = if let Self::Whole(number) = self { usize::try_from(*number).ok() } else { None };
        count.ok_or_else(|| Error::invalid(key, self, "a whole number from 0 on belongs there"))
    }

    /// The numbers of a key.
    pub fn numbers<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>, Error> {
        if self.get(key)?.is_none() {
            return Ok(None);
        }
        let wrong = |got: String| Error::invalid(key, got, format!("{N} numbers belong there"));
        let items: &[Self; N] =
            self.list(key)?.try_into().map_err(|_| wrong("another number of them".to_owned()))?;
        let number = |value: &Self| match value {
            Self::Whole(number) => Ok(*number as f64),
            Self::Real(number) => Ok(*number),
            other => Err(wrong(other.to_string())),
        };
        memory::try_map(items.each_ref(), number).map(Some)
    }
}

impl fmt::Display for Json<'_> {
    /// Shows a short text for errors.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => out.write_str("null"),
            Self::Flag(flag) => write!(out, "{flag}"),
            Self::Whole(number) => write!(out, "{number}"),
            Self::Real(number) => write!(out, "{number:?}"),
            Self::Text(text) => out.write_str(&shown(text.as_bytes())),
            Self::List(_) => out.write_str("a list"),
            Self::Object(_) => out.write_str("an object"),
        }
    }
}

/// Reads values, and keeps the error of the crate that ends the reading.
#[derive(Clone, Copy)]
struct Reader<'r> {
    failure: &'r Cell<Option<Error>>,
    execution: &'r Execution,
}

impl Reader<'_> {
    fn keep<T, E: serde_core::de::Error>(self, result: Result<T, Error>) -> Result<T, E> {
        result.map_err(|failure| {
            self.failure.set(Some(failure));
            E::custom("stopped")
        })
    }
}

impl<'de> DeserializeSeed<'de> for Reader<'_> {
    type Value = Json<'de>;

    fn deserialize<D: Deserializer<'de>>(self, source: D) -> Result<Json<'de>, D::Error> {
        source.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Reader<'_> {
    type Value = Json<'de>;

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("a value")
    }

    fn visit_unit<E>(self) -> Result<Json<'de>, E> {
        Ok(Json::Null)
    }

    fn visit_bool<E>(self, flag: bool) -> Result<Json<'de>, E> {
        Ok(Json::Flag(flag))
    }

    fn visit_i64<E>(self, number: i64) -> Result<Json<'de>, E> {
        Ok(Json::Whole(number))
    }

    fn visit_u64<E>(self, number: u64) -> Result<Json<'de>, E> {
        Ok(i64::try_from(number).map_or(Json::Real(number as f64), Json::Whole))
    }

    fn visit_f64<E>(self, number: f64) -> Result<Json<'de>, E> {
        Ok(Json::Real(number))
    }

    fn visit_borrowed_str<E>(self, text: &'de str) -> Result<Json<'de>, E> {
        Ok(Json::Text(Cow::Borrowed(text)))
    }

    /// Copies a string that has escapes.
    fn visit_str<E: serde_core::de::Error>(self, text: &str) -> Result<Json<'de>, E> {
        self.keep(copied(text)).map(|text| Json::Text(Cow::Owned(text)))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut source: A) -> Result<Json<'de>, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = source.next_element_seed(self)? {
            self.keep(self.execution.check().and_then(|()| memory::push(&mut items, item)))?;
        }
        Ok(Json::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut source: A) -> Result<Json<'de>, A::Error> {
        let mut entries = HashMap::new();
        while let Some((key, value)) = source.next_entry_seed(self, self)? {
            let Json::Text(key) = key else { return Err(A::Error::custom("a key that is no string")) };
            let bytes = (entries.len() + 1) * size_of::<(Cow<str>, Json)>();
            let room = entries.try_reserve(1).map_err(|_| Error::OutOfMemory { bytes });
            self.keep(self.execution.check().and(room))?;
            entries.insert(key, value);
        }
        Ok(Json::Object(entries))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Json<'_>, Error> {
        parse(text.as_bytes(), &Execution::default())
    }

    #[test]
    fn values_are_read_by_their_keys() -> Result<(), Error> {
        let text = r#"{"a": [1, 0.1, -2], "b": {"c\u0041": "x"}, "d": 1e2, "n": null, "a": [3, 0.3, -4]}"#;
        let found = read(text)?;
        assert_eq!(found.numbers("a"), Ok(Some([3.0, 0.3, -4.0])));
        assert_eq!(found.need("b")?.need("cA"), Ok(&Json::Text("x".into())));
        assert_eq!((found.get("n"), found.count("n"), found.list("n")), (Ok(None), Ok(None), Ok(&[][..])));
        assert_eq!(read("[18446744073709551615, true]")?.to_string(), "a list");
        Ok(())
    }

    #[test]
    fn errors_name_the_key() -> Result<(), Error> {
        let found = read(r#"{"a": -1, "b": 4e9, "c": "x", "d": [1, true], "e": 18446744073709551615}"#)?;
        for (error, says) in [
            (found.count("a").err(), "a: got -1; a whole number"),
            (found.count("b").err(), "b: got 4000000000.0; a whole number"),
            (found.count("e").err(), "e: got 1.8446744073709552e19; a whole number"),
            (found.list("c").err(), "c: got \"x\"; a list belongs there"),
            (found.numbers::<3>("d").err(), "d: got another number of them; 3 numbers"),
            (found.numbers::<2>("d").err(), "d: got true; 2 numbers"),
            (found.needed_count("f").err(), "f: got nothing"),
            (found.need("c")?.get("g").err(), "an object with g belongs there"),
            (read("").err(), "JSON: got a fault; EOF while parsing a value at line 1 column 0"),
            (read("{} {}").err(), "trailing characters"),
            (read("NaN").err(), "expected value"),
            (read(&"[".repeat(100_000)).err(), "recursion limit exceeded"),
        ] {
            let error = error.map_or_else(|| "nothing".to_owned(), |error| error.to_string());
            assert!(error.contains(says), "{error}");
        }
        Ok(())
    }

    #[test]
    fn reading_is_interrupted() {
        let execution = Execution::default();
        execution.interrupt();
        assert_eq!(parse(b"[1]", &execution), Err(Error::Interrupted));
        assert_eq!(parse(b"{\"a\": 1}", &execution), Err(Error::Interrupted));
    }
}
