//! Point formats 6 to 10: the items of a chunk's points are stored in layers, each a separate bit sequence.
//! The layers of coordinates, intensities and colours are decoded, all others are skipped.

use super::super::{Point, Points, bytes_at, color_at, intensity_at, position_at};
use super::arithmetic::{Decoder, Model};
use super::colors::Colors;
use super::cut_off;
use super::integers::{Integers, Median};
use super::items::{Kind, Layout};
use super::pointwise::{height_context, step};
use crate::error::Result;
use crate::execution::Execution;

/// Scanner channels, whose points are predicted separately.
const CHANNELS: usize = 4;
/// Bytes of a position with its attributes.
const POSITION: usize = 30;
/// Layers of a position: returns with x and y, z, intensities, and those that are skipped.
const POSITION_LAYERS: usize = 9;
/// The layer of intensities.
const INTENSITY_LAYER: usize = 4;
/// Bytes of a layer's size, and of the number of points before the sizes.
const SIZE: usize = 4;

/// Adds the points of a chunk: the first one, and `more` after it.
pub(super) fn read(
    layout: &Layout,
    first: &[u8],
    rest: &[u8],
    more: usize,
    points: &mut Points,
    execution: &Execution,
) -> Result<()> {
    let layers = layers(layout, rest).ok_or_else(cut_off)?;
    let mut point = Point {
        position: position_at(first),
        intensity: intensity_at(first),
        color: if has_color(layout) { color_at(first, POSITION) } else { [0; 3] },
    };
    // Before version 4, colours follow the channel only if it has just changed.
    let is_version_4 = layout.items.iter().all(|item| item.version == 4);
    let mut positions = Positions::new(first, &layers, &point);
    let mut colors =
        has_color(layout).then(|| LayeredColors::new(layers.color, positions.channel, point.color));
    points.push(&point)?;
    for _ in 0..more {
        execution.check()?;
        let has_switched = positions.next(&mut point)?;
        if let Some(colors) = &mut colors {
            let channel = if is_version_4 || has_switched { positions.channel } else { 0 };
            point.color = colors.next(channel, is_version_4)?;
        }
        points.push(&point)?;
    }
    Ok(())
}

/// Whether there are colours, which directly follow the position.
fn has_color(layout: &Layout) -> bool {
    layout.items.get(1).is_some_and(|item| item.kind.is_color())
}

/// The layers used; an empty one means that nothing changes.
struct Layers<'a> {
    returns: &'a [u8],
    z: &'a [u8],
    intensity: &'a [u8],
    color: &'a [u8],
}

/// Splits the bytes after a chunk's first point; `None` if a layer exceeds them.
fn layers<'a>(layout: &Layout, rest: &'a [u8]) -> Option<Layers<'a>> {
    let numbers = layout.items.iter().map(|item| match item.kind {
        Kind::LayeredPosition => POSITION_LAYERS,
        Kind::LayeredColorAndInfrared => 2,
        Kind::LayeredBytes => item.size,
        _ => 1,
    });
    let number = numbers.sum::<usize>();
    let (sizes, mut bytes) = rest.get(SIZE..)?.split_at_checked(number * SIZE)?;
    let mut layers = Layers { returns: &[], z: &[], intensity: &[], color: &[] };
    for (i, size) in sizes.as_chunks().0.iter().enumerate() {
        let (layer, behind) = bytes.split_at_checked(u32::from_le_bytes(*size) as usize)?;
        match i {
            0 => layers.returns = layer,
            1 => layers.z = layer,
            INTENSITY_LAYER => layers.intensity = layer,
            POSITION_LAYERS if has_color(layout) => layers.color = layer,
            _ => {}
        }
        bytes = behind;
    }
    Some(layers)
}

/// Context of a return's steps within its pulse, by the number of returns and the return's own number.
const RETURNS: [[u8; 16]; 16] = [
    [0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5],
    [1, 0, 1, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3],
    [2, 1, 2, 4, 4, 4, 4, 4, 4, 4, 4, 3, 3, 3, 3, 3],
    [3, 3, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [3, 3, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5],
];

/// Decoder of the coordinates and intensities.
struct Positions<'a> {
    returns: Decoder<'a>,
    z: Option<Decoder<'a>>,
    intensity: Option<Decoder<'a>>,
    channel: usize,
    /// `None` until the channel has a point.
    channels: [Option<Box<Channel>>; CHANNELS],
}

/// State that predicts the points of a channel.
struct Channel {
    position: [i32; 3],
    /// Number of the last return, and number of returns of its pulse.
    this: usize,
    number: usize,
    has_new_time: bool,
    changed: [Model; 8],
    switches: Model,
    numbers: [Model; 16],
    returns: [Model; 16],
    returns_at_the_same_time: Model,
    x: Integers,
    y: Integers,
    z: Integers,
    /// Medians of the steps in x and y, by the context of the return and whether its time is new.
    steps: [[Median; 2]; 12],
    /// The last height, by the number of later returns of the pulse.
    heights: [i32; 8],
    intensity: u16,
    intensities: Integers,
    /// The last intensity, by the place of the return in its pulse and whether its time is new.
    last_intensities: [u16; 8],
}

impl Channel {
    /// A channel whose first point follows one of another channel.
    fn new(position: [i32; 3], intensity: u16, this: usize, number: usize) -> Box<Self> {
        Box::new(Self {
            position,
            this,
            number,
            has_new_time: false,
            changed: Model::several(128),
            switches: Model::new(CHANNELS as u16 - 1),
            numbers: Model::several(16),
            returns: Model::several(16),
            returns_at_the_same_time: Model::new(13),
            x: Integers::new(32, 2),
            y: Integers::new(32, 22),
            z: Integers::new(32, 20),
            steps: Default::default(),
            heights: [position[2]; 8],
            intensity,
            intensities: Integers::new(16, 4),
            last_intensities: [intensity; 8],
        })
    }
}

impl<'a> Positions<'a> {
    fn new(first: &[u8], layers: &Layers<'a>, point: &Point) -> Self {
        let byte = |at| bytes_at::<1>(first, at).map_or(0, |[byte]| usize::from(byte));
        let channel = byte(15) >> 4 & 3;
        let mut channels = [const { None }; CHANNELS];
        let (this, number) = (byte(14) & 15, byte(14) >> 4);
        channels[channel] = Some(Channel::new(point.position, point.intensity, this, number));
        let decoder = |layer: &'a [u8]| (!layer.is_empty()).then(|| Decoder::new(layer));
        Self {
            returns: Decoder::new(layers.returns),
            z: decoder(layers.z),
            intensity: decoder(layers.intensity),
            channel,
            channels,
        }
    }

    /// Decodes the next point; returns whether its channel differs.
    fn next(&mut self, point: &mut Point) -> Result<bool> {
        let decoder = &mut self.returns;
        let mut last = self.channels[self.channel].as_mut().ok_or_else(cut_off)?;
        let context = usize::from(last.this == 1)
            + 2 * usize::from(last.this >= last.number)
            + 4 * usize::from(last.has_new_time);
        let changed = decoder.symbol(&mut last.changed[context])?;
        let has_switched = changed & 1 << 6 != 0;
        if has_switched {
            self.channel = (self.channel + 1 + decoder.symbol(&mut last.switches)?) % CHANNELS;
            let (position, intensity, this, number) = (last.position, last.intensity, last.this, last.number);
            last = self.channels[self.channel]
                .get_or_insert_with(|| Channel::new(position, intensity, this, number));
        }
        last.has_new_time = changed & 1 << 4 != 0;
        if changed & 1 << 2 != 0 {
            last.number = decoder.symbol(&mut last.numbers[last.number])?;
        }
        last.this = match changed & 3 {
            0 => last.this,
            1 => (last.this + 1) % 16,
            2 => (last.this + 15) % 16,
            _ if last.has_new_time => decoder.symbol(&mut last.returns[last.this])?,
            _ => (last.this + 2 + decoder.symbol(&mut last.returns_at_the_same_time)?) % 16,
        };
        let context = usize::from(RETURNS[last.number][last.this]);
        let steps = &mut last.steps[2 * context + usize::from(last.has_new_time)];
        let is_single = last.number == 1;
        step(decoder, &mut last.position, [&mut last.x, &mut last.y], steps, is_single)?;
        if let Some(decoder) = &mut self.z {
            let height = &mut last.heights[last.number.abs_diff(last.this).min(7)];
            *height = last.z.next(decoder, *height, height_context(&last.x, &last.y, is_single))?;
            last.position[2] = *height;
        }
        if let Some(decoder) = &mut self.intensity {
            let context = 2 * usize::from(last.this == 1) + usize::from(last.this >= last.number);
            let intensity = &mut last.last_intensities[2 * context + usize::from(last.has_new_time)];
            *intensity = last.intensities.next(decoder, i32::from(*intensity), context)? as u16;
            last.intensity = *intensity;
        }
        let is_cut_off = |decoder: &Option<Decoder>| decoder.as_ref().is_some_and(Decoder::is_cut_off);
        if self.returns.is_cut_off() || is_cut_off(&self.z) || is_cut_off(&self.intensity) {
            return Err(cut_off());
        }
        (point.position, point.intensity) = (last.position, last.intensity);
        Ok(has_switched)
    }
}

/// Decoder of the colours.
struct LayeredColors<'a> {
    decoder: Option<Decoder<'a>>,
    channel: usize,
    models: [Colors; CHANNELS],
    /// The last colour of each channel that had a point.
    last: [Option<[u16; 3]>; CHANNELS],
}

impl<'a> LayeredColors<'a> {
    /// Decoder that begins with a colour.
    fn new(layer: &'a [u8], channel: usize, color: [u16; 3]) -> Self {
        let mut last = [None; CHANNELS];
        last[channel] = Some(color);
        let decoder = (!layer.is_empty()).then(|| Decoder::new(layer));
        Self { decoder, channel, models: Default::default(), last }
    }

    /// Decodes the next colour of a channel.
    fn next(&mut self, channel: usize, is_version_4: bool) -> Result<[u16; 3]> {
        let mut place = self.channel;
        if channel != place {
            let is_new = self.last[channel].is_none();
            if is_new {
                self.last[channel] = self.last[place];
            }
            // Before version 4, a channel that had points continues from the previous channel's last colour.
            if is_new || is_version_4 {
                place = channel;
            }
            self.channel = channel;
        }
        let mut color = self.last[place].unwrap_or_default();
        if let Some(decoder) = &mut self.decoder {
            color = self.models[channel].next(decoder, color)?;
            if decoder.is_cut_off() {
                return Err(cut_off());
            }
        }
        self.last[place] = Some(color);
        Ok(color)
    }
}
