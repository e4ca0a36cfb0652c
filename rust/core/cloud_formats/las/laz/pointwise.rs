//! Point formats 0 to 5: the items of a point follow each other in one bit sequence.

use super::super::{Point, Points, bytes_at, color_at, intensity_at, position_at};
use super::arithmetic::{Decoder, Model};
use super::colors::{Colors, ColorsOfVersion1};
use super::cut_off;
use super::integers::{Integers, Median};
use super::items::{Item, Kind, Layout};
use super::times::{Times, TimesOfVersion1};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// Adds the points of a chunk: the first one, and `more` after it.
pub(super) fn read(
    layout: &Layout,
    first: &[u8],
    rest: &[u8],
    more: usize,
    points: &mut Points,
    execution: &Execution,
) -> Result<()> {
    let mut point = Point::default();
    let mut fields: Vec<Box<dyn Field>> = Vec::new();
    let mut record = first;
    for item in &layout.items {
        let (bytes, behind) = record.split_at_checked(item.size).ok_or_else(cut_off)?;
        fields.push(field(*item, bytes, &mut point)?);
        record = behind;
    }
    points.push(&point)?;
    let mut decoder = Decoder::new(rest);
    for _ in 0..more {
        execution.check()?;
        for field in &mut fields {
            field.next(&mut decoder, &mut point)?;
        }
        if decoder.is_cut_off() {
            return Err(cut_off());
        }
        points.push(&point)?;
    }
    Ok(())
}

/// A decoder of one item.
trait Field {
    /// Decodes the item of the next point, and writes its used values to the point.
    fn next(&mut self, decoder: &mut Decoder, point: &mut Point) -> Result<()>;
}

/// The decoder of an item that begins with these bytes.
fn field(item: Item, bytes: &[u8], point: &mut Point) -> Result<Box<dyn Field>> {
    let is_old = item.version == 1;
    Ok(match item.kind {
        Kind::Position => {
            (point.position, point.intensity) = (position_at(bytes), intensity_at(bytes));
            let attributes = Attributes::new(bytes);
            if is_old {
                Box::new(PositionsOfVersion1::new(attributes))
            } else {
                Box::new(Positions::new(attributes))
            }
        }
        Kind::Color => {
            point.color = color_at(bytes, 0);
            if is_old { Box::<ColorsOfVersion1>::default() } else { Box::<Colors>::default() }
        }
        Kind::Time if is_old => Box::<TimesOfVersion1>::default(),
        Kind::Time => Box::<Times>::default(),
        Kind::Wave => Box::<Waves>::default(),
        _ if is_old => Box::new(BytesOfVersion1 { integers: Integers::new(8, item.size), count: item.size }),
        _ => Box::new(Bytes { models: memory::collect((0..item.size).map(|_| Model::new(256)))? }),
    })
}

impl Field for Colors {
    fn next(&mut self, decoder: &mut Decoder, point: &mut Point) -> Result<()> {
        point.color = Self::next(self, decoder, point.color)?;
        Ok(())
    }
}

impl Field for ColorsOfVersion1 {
    fn next(&mut self, decoder: &mut Decoder, point: &mut Point) -> Result<()> {
        point.color = Self::next(self, decoder, point.color)?;
        Ok(())
    }
}

impl Field for Times {
    fn next(&mut self, decoder: &mut Decoder, _: &mut Point) -> Result<()> {
        Self::next(self, decoder)
    }
}

impl Field for TimesOfVersion1 {
    fn next(&mut self, decoder: &mut Decoder, _: &mut Point) -> Result<()> {
        Self::next(self, decoder)
    }
}

/// Context of a point's return within its pulse, by the number of returns and the return's own number.
/// Impossible combinations also have contexts, since files contain them.
const RETURNS: [[u8; 8]; 8] = [
    [15, 14, 13, 12, 11, 10, 9, 8],
    [14, 0, 1, 3, 6, 10, 10, 9],
    [13, 1, 2, 4, 7, 11, 11, 10],
    [12, 3, 4, 5, 8, 12, 12, 11],
    [11, 6, 7, 8, 9, 13, 13, 12],
    [10, 10, 11, 12, 13, 14, 14, 13],
    [9, 10, 11, 12, 13, 14, 15, 14],
    [8, 9, 10, 11, 12, 13, 14, 15],
];

/// Other content of item 6: returns, class and so on.
struct Attributes {
    returns: u8,
    class: u8,
    user: u8,
    /// Models by the previous value.
    returns_after: Vec<Model>,
    classes_after: Vec<Model>,
    users_after: Vec<Model>,
}

impl Attributes {
    fn new(bytes: &[u8]) -> Self {
        let byte = |at| bytes_at::<1>(bytes, at).map_or(0, |[byte]| byte);
        let models = || (0..256).map(|_| Model::new(256)).collect();
        Self {
            returns: byte(14),
            class: byte(15),
            user: byte(17),
            returns_after: models(),
            classes_after: models(),
            users_after: models(),
        }
    }

    fn next_returns(&mut self, decoder: &mut Decoder) -> Result<()> {
        self.returns = decoder.symbol(&mut self.returns_after[usize::from(self.returns)])? as u8;
        Ok(())
    }

    fn next_class(&mut self, decoder: &mut Decoder) -> Result<()> {
        self.class = decoder.symbol(&mut self.classes_after[usize::from(self.class)])? as u8;
        Ok(())
    }

    fn next_user(&mut self, decoder: &mut Decoder) -> Result<()> {
        self.user = decoder.symbol(&mut self.users_after[usize::from(self.user)])? as u8;
        Ok(())
    }
}

/// Coordinates since version 2.
struct Positions {
    attributes: Attributes,
    changed: Model,
    intensities: Integers,
    /// The last intensity, by the context of the return.
    last_intensities: [u16; 16],
    angles: [Model; 2],
    sources: Integers,
    x: Integers,
    y: Integers,
    z: Integers,
    /// Medians of the steps in x and y, by the context of the return.
    steps: [[Median; 2]; 16],
    /// The last height, by the number of later returns of the pulse.
    heights: [i32; 8],
}

impl Positions {
    fn new(attributes: Attributes) -> Self {
        Self {
            attributes,
            changed: Model::new(64),
            intensities: Integers::new(16, 4),
            last_intensities: [0; 16],
            angles: Model::several(256),
            sources: Integers::new(16, 1),
            x: Integers::new(32, 2),
            y: Integers::new(32, 22),
            z: Integers::new(32, 20),
            steps: Default::default(),
            heights: [0; 8],
        }
    }
}

impl Field for Positions {
    fn next(&mut self, decoder: &mut Decoder, point: &mut Point) -> Result<()> {
        let changed = decoder.symbol(&mut self.changed)?;
        if changed & 1 << 5 != 0 {
            self.attributes.next_returns(decoder)?;
        }
        let returns = self.attributes.returns;
        let (this, number) = (usize::from(returns & 7), usize::from(returns >> 3 & 7));
        let context = usize::from(RETURNS[number][this]);
        let intensity = &mut self.last_intensities[context];
        if changed & 1 << 4 != 0 {
            *intensity = self.intensities.next(decoder, i32::from(*intensity), context.min(3))? as u16;
        }
        point.intensity = *intensity;
        if changed & 1 << 3 != 0 {
            self.attributes.next_class(decoder)?;
        }
        if changed & 1 << 2 != 0 {
            decoder.symbol(&mut self.angles[usize::from(returns >> 6 & 1)])?;
        }
        if changed & 1 << 1 != 0 {
            self.attributes.next_user(decoder)?;
        }
        if changed & 1 != 0 {
            self.sources.next(decoder, 0, 0)?;
        }
        let is_single = number == 1;
        step(decoder, &mut point.position, [&mut self.x, &mut self.y], &mut self.steps[context], is_single)?;
        let height = &mut self.heights[number.abs_diff(this)];
        *height = self.z.next(decoder, *height, height_context(&self.x, &self.y, is_single))?;
        point.position[2] = *height;
        Ok(())
    }
}

/// Moves x and y by steps predicted from the previous ones.
pub(super) fn step(
    decoder: &mut Decoder,
    position: &mut [i32; 3],
    [x, y]: [&mut Integers; 2],
    [last_x, last_y]: &mut [Median; 2],
    is_single: bool,
) -> Result<()> {
    let step = x.next(decoder, last_x.get(), usize::from(is_single))?;
    last_x.add(step);
    position[0] = position[0].wrapping_add(step);
    let context = usize::from(is_single) + x.size().min(20) as usize / 2 * 2;
    let step = y.next(decoder, last_y.get(), context)?;
    last_y.add(step);
    position[1] = position[1].wrapping_add(step);
    Ok(())
}

/// Context of a point's height, by its distance from the last point.
pub(super) fn height_context(x: &Integers, y: &Integers, is_single: bool) -> usize {
    usize::from(is_single) + (usize::midpoint(x.size() as usize, y.size() as usize)).min(18) / 2 * 2
}

/// Coordinates in version 1.
struct PositionsOfVersion1 {
    attributes: Attributes,
    changed: Model,
    intensities: Integers,
    angles: Integers,
    sources: Integers,
    x: Integers,
    y: Integers,
    z: Integers,
    /// The last three steps in x and y.
    steps: [[i32; 3]; 2],
}

impl PositionsOfVersion1 {
    fn new(attributes: Attributes) -> Self {
        Self {
            attributes,
            changed: Model::new(64),
            intensities: Integers::new(16, 1),
            angles: Integers::new(8, 2),
            sources: Integers::new(16, 1),
            x: Integers::new(32, 1),
            y: Integers::new(32, 20),
            z: Integers::new(32, 20),
            steps: [[0; 3]; 2],
        }
    }
}

impl Field for PositionsOfVersion1 {
    fn next(&mut self, decoder: &mut Decoder, point: &mut Point) -> Result<()> {
        let [x, y] = self.steps.map(median);
        let x = self.x.next(decoder, x, 0)?;
        let y = self.y.next(decoder, y, self.x.size().min(19) as usize)?;
        for (axis, step) in [x, y].into_iter().enumerate() {
            self.steps[axis].rotate_right(1);
            self.steps[axis][0] = step;
            point.position[axis] = point.position[axis].wrapping_add(step);
        }
        let size = usize::midpoint(self.x.size() as usize, self.y.size() as usize);
        point.position[2] = self.z.next(decoder, point.position[2], size.min(19))?;
        let changed = decoder.symbol(&mut self.changed)?;
        if changed & 1 << 5 != 0 {
            point.intensity = self.intensities.next(decoder, i32::from(point.intensity), 0)? as u16;
        }
        if changed & 1 << 4 != 0 {
            self.attributes.next_returns(decoder)?;
        }
        if changed & 1 << 3 != 0 {
            self.attributes.next_class(decoder)?;
        }
        if changed & 1 << 2 != 0 {
            self.angles.next(decoder, 0, usize::from(size < 3))?;
        }
        if changed & 1 << 1 != 0 {
            self.attributes.next_user(decoder)?;
        }
        if changed & 1 != 0 {
            self.sources.next(decoder, 0, 0)?;
        }
        Ok(())
    }
}

fn median(mut steps: [i32; 3]) -> i32 {
    steps.sort_unstable();
    steps[1]
}

/// Descriptions of waveforms, decoded only to skip their bits.
struct Waves {
    indices: Model,
    /// Models of the offset's coding, by the coding of the last one.
    kinds: [Model; 4],
    kind: usize,
    distances: Integers,
    sizes: Integers,
    places: Integers,
    directions: Integers,
}

impl Default for Waves {
    fn default() -> Self {
        Self {
            indices: Model::new(256),
            kinds: Model::several(4),
            kind: 0,
            distances: Integers::new(32, 1),
            sizes: Integers::new(32, 1),
            places: Integers::new(32, 1),
            directions: Integers::new(32, 3),
        }
    }
}

impl Field for Waves {
    fn next(&mut self, decoder: &mut Decoder, _: &mut Point) -> Result<()> {
        decoder.symbol(&mut self.indices)?;
        self.kind = decoder.symbol(&mut self.kinds[self.kind])?;
        match self.kind {
            2 => {
                self.distances.next(decoder, 0, 0)?;
            }
            3 => {
                decoder.bits(32);
                decoder.bits(32);
            }
            _ => {}
        }
        self.sizes.next(decoder, 0, 0)?;
        self.places.next(decoder, 0, 0)?;
        for axis in 0..3 {
            self.directions.next(decoder, 0, axis)?;
        }
        Ok(())
    }
}

/// Extra bytes, since version 2.
struct Bytes {
    models: Vec<Model>,
}

impl Field for Bytes {
    fn next(&mut self, decoder: &mut Decoder, _: &mut Point) -> Result<()> {
        self.models.iter_mut().try_for_each(|model| decoder.symbol(model).map(drop))
    }
}

/// Extra bytes, in version 1.
struct BytesOfVersion1 {
    integers: Integers,
    count: usize,
}

impl Field for BytesOfVersion1 {
    fn next(&mut self, decoder: &mut Decoder, _: &mut Point) -> Result<()> {
        (0..self.count).try_for_each(|place| self.integers.next(decoder, 0, place).map(drop))
    }
}
