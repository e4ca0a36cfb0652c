//! Writes E57: scans with their poses, in pages with checksums.
//!
//! Coordinates and normals are float64, so that no point moves. Colours have 8 bits, since readers expect no
//! more; intensities are float32. The bytes of a file are returned as they are complete; the first page is
//! returned at the end, since it has the place of the description.

use std::fmt::Write as _;

use super::{DATA_PACKET, HEAD, PAGE, USED, seal};
use crate::error::{Error, Result};
use crate::memory;

/// Bytes of the header of a file, of a section, and of its index.
const FILE_HEAD: usize = 48;
const SECTION_HEAD: u64 = 32;
const INDEX: u64 = 32;

/// Points of a packet, which has at most 64 KiB.
const PER_PACKET: usize = 1024;

/// Names of columns, their types, and bytes of a number.
const POSITION: [&str; 3] = ["cartesianX", "cartesianY", "cartesianZ"];
const NORMAL: [&str; 3] = ["nor:normalX", "nor:normalY", "nor:normalZ"];
const COLOR: [&str; 3] = ["colorRed", "colorGreen", "colorBlue"];
const INTENSITY: &str = "intensity";
const REAL: usize = size_of::<f64>();

/// Points of a scan, in its own frame. The slices have one length.
#[derive(Debug, Clone, Copy)]
pub struct Points<'a> {
    /// Coordinates.
    pub points: &'a [[f64; 3]],
    /// Normals of the extension for surface normals.
    pub normals: Option<&'a [[f64; 3]]>,
    /// Red, green, blue.
    pub colors: Option<&'a [[u8; 3]]>,
    /// Intensities.
    pub intensities: Option<&'a [f32]>,
}

/// Pose of a scan: position, and quaternion w x y z.
pub type Pose = ([f64; 3], [f64; 4]);

/// Writes a file.
#[derive(Debug)]
pub struct Writer {
    /// Content of pages that are not complete.
    rest: Vec<u8>,
    /// Bytes of the content before `rest`.
    before: u64,
    /// Content of the first page.
    first: Option<[u8; USED]>,
    /// Hash of the checksums of complete pages.
    hash: u64,
    scans: Vec<Scan>,
}

/// A scan being written, or complete.
#[derive(Debug)]
struct Scan {
    name: String,
    pose: Pose,
    count: u64,
    written: u64,
    section: u64,
    columns: Columns,
    /// Bytes of each column that are not in a packet yet.
    streams: Vec<Vec<u8>>,
    low: [f64; 3],
    high: [f64; 3],
    least_intensity: f32,
    greatest_intensity: f32,
}

/// The columns of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Columns {
    normals: bool,
    colors: bool,
    intensities: bool,
}

impl Columns {
    fn of(points: &Points<'_>) -> Self {
        let Points { normals, colors, intensities, .. } = points;
        Self { normals: normals.is_some(), colors: colors.is_some(), intensities: intensities.is_some() }
    }

    /// Bytes of the numbers of a point.
    fn sizes(self) -> impl Iterator<Item = usize> {
        let reals = if self.normals { 6 } else { 3 };
        let colors = if self.colors { 3 } else { 0 };
        let intensities = self.intensities.then_some(size_of::<f32>());
        std::iter::repeat_n(REAL, reals).chain(std::iter::repeat_n(1, colors)).chain(intensities)
    }

    /// Bytes of a packet of points, and of all packets.
    fn packet(self, count: usize) -> usize {
        (HEAD + self.sizes().map(|size| size_of::<u16>() + size * count).sum::<usize>()).next_multiple_of(4)
    }

    fn packets(self, count: u64) -> u64 {
        let (whole, rest) = (count / PER_PACKET as u64, (count % PER_PACKET as u64) as usize);
        let last = if rest > 0 { self.packet(rest) } else { 0 };
        whole * self.packet(PER_PACKET) as u64 + last as u64
    }
}

impl Writer {
    /// A file without scans.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new() -> Result<Self> {
        let (rest, hash) = (memory::filled(0, FILE_HEAD)?, 0xcbf2_9ce4_8422_2325);
        Ok(Self { rest, before: 0, first: None, hash, scans: Vec::new() })
    }

    /// Begins a scan of `count` points.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if the previous scan is not complete; [`Error::OutOfMemory`].
    pub fn begin(&mut self, name: &str, pose: Pose, count: u64) -> Result<()> {
        self.end()?;
        let scan = Scan {
            name: name.to_owned(),
            pose,
            count,
            written: 0,
            section: 0,
            columns: Columns::default(),
            streams: Vec::new(),
            low: [f64::INFINITY; 3],
            high: [f64::NEG_INFINITY; 3],
            least_intensity: f32::INFINITY,
            greatest_intensity: f32::NEG_INFINITY,
        };
        memory::push(&mut self.scans, scan)
    }

    /// Adds points to the scan.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for slices of several lengths, for other columns than before, and for more points
    /// than the scan has; [`Error::OutOfMemory`].
    pub fn add(&mut self, points: Points<'_>) -> Result<()> {
        let wrong = |got: String, remedy: &str| Err(Error::invalid("scan", got, remedy));
        let (columns, count) = (Columns::of(&points), points.points.len());
        let Some(scan) = self.scans.last() else { return wrong("points before a scan".into(), "begin one") };
        if scan.written + count as u64 > scan.count {
            let got = format!("{} points of {}", scan.written + count as u64, scan.count);
            return wrong(got, "declare the right number");
        }
        let is_new = scan.section == 0;
        if !is_new && scan.columns != columns {
            return wrong("blocks with several sets of columns".into(), "give each block the same ones");
        }
        if let Some((name, got)) = points.other_lengths().find(|&(_, got)| got != count) {
            return wrong(format!("{got} values of {name} for {count} points"), "give one per point");
        }
        if is_new {
            self.begin_section(columns)?;
        }
        for first in (0..count).step_by(PER_PACKET) {
            self.add_block(&points.part(first..count.min(first + PER_PACKET)))?;
        }
        Ok(())
    }

    /// Returns the pages that are complete, and forgets them.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn take(&mut self) -> Result<Vec<u8>> {
        let (pages, _) = self.rest.as_chunks();
        let mut sealed = memory::with_capacity(pages.len() * PAGE)?;
        if let (None, Some(first)) = (self.first, pages.first()) {
            self.first = Some(*first);
        }
        for page in pages {
            self.hash = hashed(self.hash, seal(page, &mut sealed));
        }
        let whole = pages.len() * USED;
        self.rest.drain(..whole);
        self.before += whole as u64;
        Ok(sealed)
    }

    /// Returns the rest of the file, and its first page.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if the last scan is not complete; [`Error::OutOfMemory`].
    pub fn finish(mut self) -> Result<(Vec<u8>, Vec<u8>)> {
        self.end()?;
        self.align()?;
        let place = self.place();
        let text = self.description(0);
        let hash = self
            .rest
            .iter()
            .chain(text.as_bytes())
            .fold(self.hash, |hash, &byte| hashed(hash, u32::from(byte)));
        let text = self.description(hash);
        memory::extend(&mut self.rest, text.as_bytes())?;
        let padded = self.rest.len().next_multiple_of(USED);
        memory::resize(&mut self.rest, padded, 0)?;
        let rest = self.take()?;
        let mut first = self.first.unwrap_or([0; USED]);
        let length = physical(self.before);
        let head = [length, physical(place), text.len() as u64, PAGE as u64];
        first[..8].copy_from_slice(b"ASTM-E57");
        first[8..12].copy_from_slice(&1_u32.to_le_bytes());
        for (slot, number) in first[16..].chunks_mut(8).zip(head) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        let mut page = memory::with_capacity(PAGE)?;
        seal(&first, &mut page);
        Ok((rest, page))
    }

    /// Offset of the next byte of the content.
    fn place(&self) -> u64 {
        self.before + self.rest.len() as u64
    }

    fn align(&mut self) -> Result<()> {
        let padded = self.rest.len() + (4 - self.place() % 4) as usize % 4;
        memory::resize(&mut self.rest, padded, 0)
    }

    /// Writes the header and the index of the section of points.
    fn begin_section(&mut self, columns: Columns) -> Result<()> {
        self.align()?;
        let section = self.place();
        let Some(scan) = self.scans.last_mut() else { return Ok(()) };
        (scan.section, scan.columns) = (section, columns);
        scan.streams = memory::collect(columns.sizes().map(|_| Vec::new()))?;
        let length = SECTION_HEAD + INDEX + columns.packets(scan.count);
        let (index, data) = (section + SECTION_HEAD, section + SECTION_HEAD + INDEX);
        let head = [1, length, physical(data), physical(index)].map(u64::to_le_bytes);
        memory::extend(&mut self.rest, head.as_flattened())?;
        // Of one entry: the first point is in the first packet.
        let kind_and_length = (INDEX - 1) << 16 | 1 << 32;
        let index = [kind_and_length, 0, 0, physical(data)].map(u64::to_le_bytes);
        memory::extend(&mut self.rest, index.as_flattened())
    }

    /// Adds at most as many points as a packet has.
    fn add_block(&mut self, block: &Points<'_>) -> Result<()> {
        let Some(scan) = self.scans.last_mut() else { return Ok(()) };
        scan.measure(block);
        let width = if block.normals.is_some() { 6 } else { 3 };
        for axis in 0..3 {
            push(&mut scan.streams[axis], block.points.iter().map(|point| point[axis].to_le_bytes()))?;
            if let Some(normals) = block.normals {
                let numbers = normals.iter().map(|normal| normal[axis].to_le_bytes());
                push(&mut scan.streams[3 + axis], numbers)?;
            }
            if let Some(colors) = block.colors {
                push(&mut scan.streams[width + axis], colors.iter().map(|color| [color[axis]]))?;
            }
        }
        if let (Some(intensities), Some(stream)) = (block.intensities, scan.streams.last_mut()) {
            push(stream, intensities.iter().map(|number| number.to_le_bytes()))?;
        }
        scan.written += block.points.len() as u64;
        let is_last = scan.written == scan.count;
        while let count @ 1.. = scan.waiting().min(PER_PACKET) {
            if count < PER_PACKET && !is_last {
                break;
            }
            scan.write_packet(count, &mut self.rest)?;
        }
        Ok(())
    }

    /// Ends the last scan.
    fn end(&mut self) -> Result<()> {
        let Some(scan) = self.scans.last() else { return Ok(()) };
        if scan.written < scan.count {
            let got = format!("{} of {} points of {}", scan.written, scan.count, scan.name);
            return Err(Error::invalid("scan", got, "add the others"));
        }
        if scan.count == 0 && scan.section == 0 { self.begin_section(Columns::default()) } else { Ok(()) }
    }

    /// The description of all scans; their identifiers follow from a hash.
    fn description(&self, hash: u64) -> String {
        let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
        text += "<e57Root type=\"Structure\" xmlns=\"http://www.astm.org/COMMIT/E57/2010-e57-v1.0\" ";
        text += "xmlns:nor=\"http://www.libe57.org/E57_NOR_surface_normals.txt\">\n";
        text += "<formatName type=\"String\">ASTM E57 3D Imaging Data File</formatName>\n";
        leaf(&mut text, "guid", "String", &guid(hash, 0));
        leaf(&mut text, "versionMajor", "Integer", "1");
        leaf(&mut text, "versionMinor", "Integer", "0");
        leaf(&mut text, "e57LibraryVersion", "String", concat!("cgroup ", env!("CARGO_PKG_VERSION")));
        leaf(&mut text, "coordinateMetadata", "String", "");
        text += "<data3D type=\"Vector\" allowHeterogeneousChildren=\"1\">\n";
        for (scan, number) in self.scans.iter().zip(1..) {
            scan.describe(&guid(hash, number), &mut text);
        }
        text += "</data3D>\n</e57Root>\n";
        text
    }
}

impl Scan {
    /// Number of points that are not in a packet.
    fn waiting(&self) -> usize {
        self.streams.first().map_or(0, |stream| stream.len() / REAL)
    }

    fn measure(&mut self, block: &Points<'_>) {
        for point in block.points.iter().filter(|point| point.iter().all(|x| x.is_finite())) {
            for ((low, high), &x) in self.low.iter_mut().zip(&mut self.high).zip(point) {
                *low = low.min(x);
                *high = high.max(x);
            }
        }
        for &number in block.intensities.unwrap_or_default().iter().filter(|number| number.is_finite()) {
            self.least_intensity = self.least_intensity.min(number);
            self.greatest_intensity = self.greatest_intensity.max(number);
        }
    }

    /// Moves `count` points into a data packet.
    fn write_packet(&mut self, count: usize, out: &mut Vec<u8>) -> Result<()> {
        let (length, end) = (self.columns.packet(count), out.len() + self.columns.packet(count));
        let word = |number: usize| u16::try_from(number).unwrap_or(u16::MAX).to_le_bytes();
        memory::reserve(out, length)?;
        out.extend([DATA_PACKET, 0]);
        out.extend(word(length - 1));
        out.extend(word(self.streams.len()));
        out.extend(self.columns.sizes().flat_map(|size| word(size * count)));
        for (stream, size) in self.streams.iter_mut().zip(self.columns.sizes()) {
            out.extend(stream.drain(..size * count));
        }
        memory::resize(out, end, 0)
    }

    fn describe(&self, guid: &str, text: &mut String) {
        let (place, turn) = self.pose;
        *text += "<vectorChild type=\"Structure\">\n";
        leaf(text, "guid", "String", guid);
        leaf(text, "name", "String", &escape(&self.name));
        *text += "<pose type=\"Structure\"><rotation type=\"Structure\">";
        reals(text, ["w", "x", "y", "z"], turn);
        *text += "</rotation><translation type=\"Structure\">";
        reals(text, ["x", "y", "z"], place);
        *text += "</translation></pose>\n";
        if self.low[0] <= self.high[0] {
            *text += "<cartesianBounds type=\"Structure\">";
            reals(text, ["xMinimum", "yMinimum", "zMinimum"], self.low);
            reals(text, ["xMaximum", "yMaximum", "zMaximum"], self.high);
            *text += "</cartesianBounds>\n";
        }
        let Columns { normals, colors, intensities } = self.columns;
        if colors {
            *text += "<colorLimits type=\"Structure\">";
            for name in COLOR {
                leaf(text, &format!("{name}Minimum"), "Integer", "0");
                leaf(text, &format!("{name}Maximum"), "Integer", "255");
            }
            *text += "</colorLimits>\n";
        }
        if self.least_intensity <= self.greatest_intensity {
            *text += "<intensityLimits type=\"Structure\">";
            leaf(text, "intensityMinimum", "Float", &format!("{:e}", self.least_intensity));
            leaf(text, "intensityMaximum", "Float", &format!("{:e}", self.greatest_intensity));
            *text += "</intensityLimits>\n";
        }
        let (offset, count) = (physical(self.section), self.count);
        let _ = writeln!(
            text,
            "<points type=\"CompressedVector\" fileOffset=\"{offset}\" recordCount=\"{count}\">"
        );
        *text += "<prototype type=\"Structure\">\n";
        let real = |name| format!("<{name} type=\"Float\"/>\n");
        *text += &POSITION.map(real).concat();
        if normals {
            *text += &NORMAL.map(real).concat();
        }
        let whole = |name, most| format!("<{name} type=\"Integer\" minimum=\"0\" maximum=\"{most}\"/>\n");
        if colors {
            *text += &COLOR.map(|name| whole(name, u16::from(u8::MAX))).concat();
        }
        if intensities {
            let _ = writeln!(text, "<{INTENSITY} type=\"Float\" precision=\"single\"/>");
        }
        *text += "</prototype>\n<codecs type=\"Vector\" allowHeterogeneousChildren=\"1\"/>\n</points>\n</vectorChild>\n";
    }
}

impl<'a> Points<'a> {
    /// Names and lengths of the slices beside the coordinates.
    fn other_lengths(&self) -> impl Iterator<Item = (&'static str, usize)> {
        let lengths =
            [self.normals.map(<[_]>::len), self.colors.map(<[_]>::len), self.intensities.map(<[_]>::len)];
        ["normals", "colors", "intensities"]
            .into_iter()
            .zip(lengths)
            .filter_map(|(name, len)| Some((name, len?)))
    }

    fn part(&self, rows: std::ops::Range<usize>) -> Points<'a> {
        Points {
            points: &self.points[rows.clone()],
            normals: self.normals.map(|normals| &normals[rows.clone()]),
            colors: self.colors.map(|colors| &colors[rows.clone()]),
            intensities: self.intensities.map(|intensities| &intensities[rows]),
        }
    }
}

/// Offset in the file of a byte of the content.
fn physical(place: u64) -> u64 {
    place / USED as u64 * PAGE as u64 + place % USED as u64
}

/// FNV-1a.
fn hashed(hash: u64, number: u32) -> u64 {
    (hash ^ u64::from(number)).wrapping_mul(0x0100_0000_01b3)
}

/// An identifier.
fn guid(hash: u64, number: u32) -> String {
    let high = hashed(hash, number);
    let low = hashed(high.rotate_left(32), number);
    let [a, b, c] = [high >> 32, high >> 16 & 0xffff, high & 0xffff];
    format!("{{{a:08X}-{b:04X}-{c:04X}-{:04X}-{:012X}}}", low >> 48, low & 0xffff_ffff_ffff)
}

fn push<const N: usize>(stream: &mut Vec<u8>, numbers: impl ExactSizeIterator<Item = [u8; N]>) -> Result<()> {
    memory::reserve(stream, N * numbers.len())?;
    stream.extend(numbers.flatten());
    Ok(())
}

fn leaf(text: &mut String, name: &str, kind: &str, content: &str) {
    let _ = writeln!(text, "<{name} type=\"{kind}\">{content}</{name}>");
}

fn reals<const N: usize>(text: &mut String, names: [&str; N], numbers: [f64; N]) {
    for (name, number) in names.into_iter().zip(numbers) {
        let _ = write!(text, "<{name} type=\"Float\">{number:?}</{name}>");
    }
}

/// The text of an element; characters that XML has not become U+FFFD.
fn escape(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        match letter {
            '&' => text += "&amp;",
            '<' => text += "&lt;",
            '>' => text += "&gt;",
            '\u{0}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}' => text.push('\u{fffd}'),
            other => text.push(other),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    use super::super::{Column, Encoding, Field, unpack, wrong_page};
    use super::*;
    use crate::Execution;

    const PLACE: Pose = ([1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0]);

    fn config() -> ProptestConfig {
        let given = ProptestConfig::default();
        let rng_seed = if given.rng_seed == RngSeed::Random { RngSeed::Fixed(0) } else { given.rng_seed };
        ProptestConfig { rng_seed, cases: 64, ..given }
    }

    /// The points of a file that is written in blocks of several sizes, and its bytes.
    fn written(blocks: &[usize], columns: Columns) -> Result<(Vec<[f64; 3]>, Vec<u8>)> {
        let count: usize = blocks.iter().sum();
        let points: Vec<_> = (0..count).map(|i| [i as f64, 0.5 - i as f64, 1e300]).collect();
        let colors: Vec<_> = (0..count).map(|i| [i as u8, (i / 3) as u8, 7]).collect();
        let intensities: Vec<_> = (0..count).map(|i| 0.5 - i as f32).collect();
        let all = Points {
            points: &points,
            normals: columns.normals.then_some(&points[..]),
            colors: columns.colors.then_some(&colors[..]),
            intensities: columns.intensities.then_some(&intensities[..]),
        };
        let mut writer = Writer::new()?;
        let mut bytes = Vec::new();
        writer.begin("before", PLACE, 3)?;
        writer.add(Points { points: &[[0.0; 3]; 3], normals: None, colors: None, intensities: None })?;
        writer.begin("a < b", PLACE, count as u64)?;
        let mut first = 0;
        for &block in blocks {
            writer.add(all.part(first..first + block))?;
            bytes.extend(writer.take()?);
            first += block;
        }
        let (rest, page) = writer.finish()?;
        bytes.extend(rest);
        bytes[..PAGE].copy_from_slice(&page);
        Ok((points, bytes))
    }

    proptest! {
        #![proptest_config(config())]

        #[test]
        fn written_numbers_are_unpacked(
            blocks in prop::collection::vec(0_usize..2_500, 0..5),
            (normals, colors, intensities) in any::<(bool, bool, bool)>(),
        ) {
            let columns = Columns { normals, colors, intensities };
            let (points, bytes) = written(&blocks, columns)?;
            prop_assert_eq!(wrong_page(&bytes), None);
            prop_assert_eq!(&bytes[16..24], (bytes.len() as u64).to_le_bytes());
            let content: Vec<_> = bytes.chunks(PAGE).flat_map(|page| &page[..USED]).copied().collect();
            let text = String::from_utf8_lossy(&content);
            let after = |name: &str| -> usize {
                let (_, rest) = text.rsplit_once(&format!("{name}=\"")).unwrap_or_default();
                rest.split('"').next().and_then(|number| number.parse().ok()).unwrap_or(0)
            };
            prop_assert!(text.contains("<name type=\"String\">a &lt; b</name>"));
            prop_assert_eq!(after("recordCount"), points.len());
            let section = after("fileOffset") / PAGE * USED + after("fileOffset") % PAGE;
            let number = |place: usize| content[place..].first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes)) as usize;
            let length = number(section + 8);
            prop_assert_eq!(number(section + 16), physical(section as u64 + 64) as usize);
            let fields: Vec<_> = columns.sizes().enumerate().map(|(column, size)| {
                let encoding = match size {
                    REAL => Encoding::Double,
                    1 => Encoding::Integer { least: 0, most: 255, scale: 1.0, offset: 0.0 },
                    _ => Encoding::Single,
                };
                Some(Field { name: column.to_string(), encoding, limits: None })
            }).collect();
            let packets = &content[section + 64..section + length];
            let found = unpack(packets, &fields, points.len(), &Execution::default())?;
            for axis in 0..3 {
                let wanted: Vec<_> = points.iter().map(|point| point[axis]).collect();
                prop_assert_eq!(&found[axis], &Column::Numbers(wanted.clone()));
                if normals {
                    prop_assert_eq!(&found[3 + axis], &Column::Numbers(wanted));
                }
            }
            if intensities {
                let wanted = (0..points.len()).map(|i| 0.5 - i as f64).collect();
                prop_assert_eq!(found.last(), Some(&Column::Numbers(wanted)));
            }
        }
    }

    #[test]
    fn files_differ_in_their_identifiers_by_their_content() -> Result<()> {
        let guid_of = |blocks: &[usize]| -> Result<Vec<u8>> {
            let (_, bytes) = written(blocks, Columns::default())?;
            let place = bytes.windows(5).position(|part| part == b"guid ").unwrap_or(0);
            Ok(bytes[place..place + 60].to_vec())
        };
        assert_eq!(guid_of(&[5, 5])?, guid_of(&[10])?);
        assert_ne!(guid_of(&[5])?, guid_of(&[6])?);
        Ok(())
    }

    #[test]
    fn wrong_numbers_of_points_are_refused() -> Result<()> {
        let one = Points { points: &[[0.0; 3]], normals: None, colors: None, intensities: None };
        let mut writer = Writer::new()?;
        assert!(writer.add(one).is_err());
        writer.begin("a", PLACE, 1)?;
        assert!(writer.begin("b", PLACE, 1).is_err());
        assert!(writer.add(Points { colors: Some(&[]), ..one }).is_err());
        writer.add(one)?;
        assert!(writer.add(one).is_err());
        writer.begin("b", PLACE, 2)?;
        writer.add(one)?;
        assert!(writer.add(Points { intensities: Some(&[1.0]), ..one }).is_err());
        assert!(writer.finish().is_err());
        Ok(())
    }
}
