//! Methods with arbitrary options.

use arbitrary::{Result, Unstructured};
use cgroup::grouping::{BoxedMethod, methods};
use cgroup::options::{Kind, OptionInfo, Value};

use super::draw::{count, length, number};

/// The methods that the paper compares come first.
const PAPER_METHODS: usize = 9;

/// The greatest count drawn often, and a number of iterations that stays fast.
const COUNTS: usize = 64;
const ROUNDS: u64 = 100;

pub fn paper_method(u: &mut Unstructured) -> Result<(&'static str, BoxedMethod)> {
    any_of(methods().into_iter().take(PAPER_METHODS).collect(), u)
}

pub fn modern_method(u: &mut Unstructured) -> Result<(&'static str, BoxedMethod)> {
    any_of(methods().into_iter().skip(PAPER_METHODS).collect(), u)
}

fn any_of(
    mut methods: Vec<(&'static str, BoxedMethod)>,
    u: &mut Unstructured,
) -> Result<(&'static str, BoxedMethod)> {
    let (name, mut method) = methods.swap_remove(u.choose_index(methods.len())?);
    for option in method.options() {
        assert!(method.set(option.name, any_value(option, u)?), "{name}: {}", option.name);
    }
    Ok((name, method))
}

/// Any value of an option's type, mostly one in its range.
fn any_value(option: &OptionInfo, u: &mut Unstructured) -> Result<Value> {
    if option.optional && u.arbitrary()? {
        return Ok(Value::None);
    }
    Ok(match option.kind {
        Kind::Flag => Value::Flag(u.arbitrary()?),
        Kind::Seed => Value::Whole(u.arbitrary()?),
        Kind::Count { .. } => Value::Whole(count(u, COUNTS)? as u64),
        Kind::Rounds { .. } => Value::Whole(u.int_in_range(0..=ROUNDS)?),
        Kind::Length => Value::Number(length(u)?),
        Kind::Cut if u.ratio(4, 5)? => Value::Word("otsu"),
        Kind::Number { .. } | Kind::Cut => Value::Number(number(u)?),
        Kind::Choice(choices) => *u.choose(choices)?,
        Kind::Scale if u.arbitrary()? => Value::Flag(u.arbitrary()?),
        Kind::Scale => Value::Range(number(u)?, number(u)?),
    })
}
