//! Every limit on what a scene may ask for, in one place; the error that refuses quotes it.

/// Longest side of a picture, rendered or read.
pub const MAX_SIDE: u32 = 65_536;
/// Most pixels of a picture, rendered or read.
pub const MAX_PIXELS: u64 = 1 << 28;
/// Most samples per pixel.
pub const MAX_SPP: u32 = 1 << 24;
/// Deepest path.
pub const MAX_DEPTH: u32 = 1 << 20;
/// Memory that an import may take: files being read and everything that is made of them.
pub const MAX_IMPORT_BYTES: u64 = 2 << 30;
/// Memory of the regular grids that a sparse volume becomes; a larger one is read coarser.
pub const MAX_VOLUME_BYTES: u64 = 1 << 30;
/// The largest main file in JSON; long arrays belong into files beside it.
pub const MAX_JSON_BYTES: u64 = 128 << 20;
/// Most numbers of one parameter of a pbrt file.
pub const MAX_NUMBERS: usize = 1 << 26;
/// Most octaves of a noise texture: finer ones are below single precision.
pub const MAX_OCTAVES: u32 = 64;
/// How deep files may include files, and blocks may lie in blocks.
pub const MAX_NESTING: usize = 64;
/// Most files that a scene may include, each counted as often as it is: files that include others twice
/// would double the work at every level.
pub const MAX_INCLUDES: u32 = 10_000;
/// Most bytes of text of all included files together, counted as often.
pub const MAX_INCLUDED_BYTES: u64 = 4 << 30;
/// Deepest nesting of instances in groups.
pub const MAX_INSTANCE_DEPTH: usize = 32;
/// Most primitives that all instances together may stand for.
pub const MAX_PLACED_PRIMITIVES: u64 = 1 << 40;
/// Findings that are listed; the rest is counted.
pub const MAX_DIAGNOSTICS: usize = 1_000;
/// Most cells of a grid by axis.
pub const MAX_GRID_SIDE: u32 = 1 << 14;
/// Most procedural clouds of a scene: each of them is tabulated, half a second of work for a line of text.
pub const MAX_CLOUDS: u32 = 16;
