//! The document of a file: its lists, and the primitives of its nodes in the frame of the scene.

use std::collections::HashMap;

use nalgebra::{Matrix3, Matrix4, Vector3};

use super::json::Json;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Bytes that any file may grow to, and how often a file may grow beyond; numbers that were measured grow a
/// few times.
const TRUSTED: usize = 64 << 20;
const MOST_GROWTH: usize = 100;

/// Counts bytes of the result: accessors can be used several times, and zeros need no buffer.
pub(super) struct Growth {
    pub packed: usize,
    pub grown: usize,
}

impl Growth {
    /// Adds bytes; refuses content that would take much more memory than its file has bytes.
    pub fn add(&mut self, more: usize) -> Result<()> {
        self.grown = self.grown.saturating_add(more);
        if self.grown <= TRUSTED.max(self.packed.saturating_mul(MOST_GROWTH)) {
            return Ok(());
        }
        let got = format!("{} bytes that would grow to {}", self.packed, self.grown);
        Err(Error::invalid("points", got, "the file is damaged, or repeats its points too often"))
    }
}

/// The lists that others refer to by rows.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    Nodes,
    Meshes,
    Accessors,
    BufferViews,
    Buffers,
}

impl Kind {
    fn key(self) -> &'static str {
        match self {
            Self::Nodes => "nodes",
            Self::Meshes => "meshes",
            Self::Accessors => "accessors",
            Self::BufferViews => "bufferViews",
            Self::Buffers => "buffers",
        }
    }
}

/// How the points of a primitive form triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mode {
    Triangles,
    Strip,
    Fan,
}

/// Triangles between points, in the order of an accessor or else of the points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Faces {
    pub mode: Mode,
    pub indices: Option<usize>,
}

/// Accessors of positions, normals and colours.
type Attributes = (usize, Option<usize>, Option<usize>);

/// Primitives of a node that have the same points.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Part {
    pub matrix: Matrix4<f64>,
    pub position: usize,
    pub normal: Option<usize>,
    pub color: Option<usize>,
    pub faces: Vec<Faces>,
}

impl Part {
    /// All accessors of the part.
    pub fn accessors(&self) -> impl Iterator<Item = usize> {
        let indices = self.faces.iter().filter_map(|faces| faces.indices);
        [self.position].into_iter().chain(self.normal).chain(self.color).chain(indices)
    }
}

/// The root object of the JSON.
#[derive(Clone, Copy)]
pub(super) struct Document<'a>(&'a Json<'a>);

impl<'a> Document<'a> {
    /// Accepts version 2.
    pub fn new(root: &'a Json<'a>) -> Result<Self> {
        let version = root.need("asset")?.need("version")?;
        let is_two = match version {
            Json::Text(text) => text.split('.').next() == Some("2"),
            Json::Whole(2) => true,
            Json::Real(number) => (2.0..3.0).contains(number),
            _ => false,
        };
        if is_two { Ok(Self(root)) } else { Err(Error::invalid("version", version, "version 2 is read")) }
    }

    pub fn list(self, kind: Kind) -> Result<&'a [Json<'a>]> {
        self.0.list(kind.key())
    }

    /// The row of a list that a value names, and its entry.
    pub fn entry(self, kind: Kind, row: &Json) -> Result<(usize, &'a Json<'a>)> {
        let items = self.list(kind)?;
        let found = if let Json::Whole(row) = row { usize::try_from(*row).ok() } else { None };
        found.and_then(|row| Some((row, items.get(row)?))).ok_or_else(|| {
            Error::invalid(kind.key(), format!("entry {row}"), format!("the file has {}", items.len()))
        })
    }

    /// The primitives of all nodes, from the first root node on.
    pub fn parts(self, growth: &mut Growth, execution: &Execution) -> Result<Vec<Part>> {
        let nodes = self.list(Kind::Nodes)?;
        let mut seen = memory::filled(false, nodes.len())?;
        let (mut parts, mut waiting) = (Vec::new(), Vec::new());
        for root in self.roots()?.into_iter().rev() {
            memory::push(&mut waiting, (root, Matrix4::identity()))?;
        }
        while let Some((row, parent)) = waiting.pop() {
            execution.check()?;
            let node = &nodes[row];
            if std::mem::replace(&mut seen[row], true) {
                let got = "two parents, or itself as parent";
                return Err(Error::invalid(format!("node {row}"), got, "a node has one parent"));
            }
            let matrix = parent * local(node)?;
            for child in node.list("children")?.iter().rev() {
                memory::push(&mut waiting, (self.entry(Kind::Nodes, child)?.0, matrix))?;
            }
            if let Some(mesh) = node.get("mesh")? {
                self.add_mesh(self.entry(Kind::Meshes, mesh)?.1, matrix, &mut parts, growth)?;
            }
        }
        Ok(parts)
    }

    /// The root nodes of the scene; without a scene, the nodes without a parent.
    fn roots(self) -> Result<Vec<usize>> {
        let scenes = self.0.list("scenes")?;
        if !scenes.is_empty() {
            let row = self.0.count("scene")?.unwrap_or(0);
            let remedy = || format!("the file has {}", scenes.len());
            let scene = scenes.get(row);
            let scene = scene.ok_or_else(|| Error::invalid("scenes", format!("entry {row}"), remedy()))?;
            let roots = scene.list("nodes")?.iter();
            return memory::try_collect(roots.map(|root| Ok(self.entry(Kind::Nodes, root)?.0)));
        }
        let nodes = self.list(Kind::Nodes)?;
        let mut is_child = memory::filled(false, nodes.len())?;
        for node in nodes {
            for child in node.list("children")? {
                is_child[self.entry(Kind::Nodes, child)?.0] = true;
            }
        }
        let roots = is_child.iter().enumerate().filter(|(_, is_child)| !**is_child);
        memory::collect(roots.map(|(row, _)| row))
    }

    /// Adds the primitives of a mesh, those that have the same points as one part.
    fn add_mesh(
        self,
        mesh: &Json,
        matrix: Matrix4<f64>,
        parts: &mut Vec<Part>,
        growth: &mut Growth,
    ) -> Result<()> {
        mesh.need("primitives")?;
        let mut places: HashMap<Attributes, usize> = HashMap::new();
        for primitive in mesh.list("primitives")? {
            growth.add(size_of::<Part>())?;
            let attributes = self.attributes(primitive)?;
            let bytes = size_of::<(Attributes, usize)>() * (places.len() + 1);
            places.try_reserve(1).map_err(|_| Error::OutOfMemory { bytes })?;
            let place = *places.entry(attributes).or_insert(parts.len());
            if place == parts.len() {
                let (position, normal, color) = attributes;
                memory::push(parts, Part { matrix, position, normal, color, faces: Vec::new() })?;
            }
            let mode = match primitive.count("mode")?.unwrap_or(4) {
                4 => Mode::Triangles,
                5 => Mode::Strip,
                6 => Mode::Fan,
                _ => continue,
            };
            let indices = self.accessor(primitive, "indices")?;
            memory::push(&mut parts[place].faces, Faces { mode, indices })?;
        }
        Ok(())
    }

    fn attributes(self, primitive: &Json) -> Result<Attributes> {
        refuse_extension(primitive, "KHR_draco_mesh_compression", "Draco")?;
        let attributes = primitive.need("attributes")?;
        let position = self.entry(Kind::Accessors, attributes.need("POSITION")?)?.0;
        Ok((position, self.accessor(attributes, "NORMAL")?, self.accessor(attributes, "COLOR_0")?))
    }

    /// The row of the accessor that a key names.
    fn accessor(self, object: &Json, key: &str) -> Result<Option<usize>> {
        Ok(object.get(key)?.map(|row| self.entry(Kind::Accessors, row)).transpose()?.map(|(row, _)| row))
    }
}

/// Refuses an object with an extension that compresses.
pub(super) fn refuse_extension(object: &Json, name: &str, compression: &str) -> Result<()> {
    let extensions = object.get("extensions")?;
    if extensions.map(|extensions| extensions.get(name)).transpose()?.flatten().is_none() {
        return Ok(());
    }
    let got = format!("content that is compressed by {compression}");
    Err(Error::invalid("extensions", got, "write the file without the compression"))
}

/// The matrix of a node: the stored one, or that of translation, rotation and scale.
fn local(node: &Json) -> Result<Matrix4<f64>> {
    if let Some(columns) = node.numbers::<16>("matrix")? {
        return Ok(Matrix4::from_column_slice(&columns));
    }
    let [x, y, z, w] = node.numbers("rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    #[rustfmt::skip]
    let turn = Matrix3::new(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    );
    let scale = Vector3::from(node.numbers("scale")?.unwrap_or([1.0; 3]));
    let shift = Vector3::from(node.numbers("translation")?.unwrap_or([0.0; 3]));
    let mut matrix = Matrix4::identity();
    for (column, factor) in scale.iter().enumerate() {
        matrix.fixed_view_mut::<3, 1>(0, column).copy_from(&(turn.column(column) * *factor));
    }
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&shift);
    Ok(matrix)
}
