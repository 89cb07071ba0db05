//! Accessors → arrays of numbers: every type, stride, normalisation and sparse patch, every offset checked first.

use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;

use super::document::Document;
use super::support;
use crate::Result;

/// Most elements of an accessor without a buffer view, which consists of zeros and sparse values.
const MAX_ZEROS: u64 = 1 << 24;

/// Type of the numbers of an accessor.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Component {
    Core(ComponentType),
    /// 64-bit float, of `KHR_accessor_float64`.
    Double,
}

impl Component {
    fn size(self) -> usize {
        match self {
            Component::Core(core) => core.size(),
            Component::Double => 8,
        }
    }

    fn is_unsigned(self) -> bool {
        matches!(self, Component::Core(ComponentType::U8 | ComponentType::U16 | ComponentType::U32))
    }
}

/// How the elements of an accessor are stored.
struct Layout {
    component: Component,
    normalized: bool,
    /// Numbers in an element, and bytes of it.
    width: usize,
    size: usize,
    count: usize,
}

impl Document {
    /// Read elements of `least` to `N` numbers; missing numbers are taken from `fill`.
    pub fn read_floats<const N: usize>(
        &self,
        index: usize,
        least: usize,
        fill: [f32; N],
        at: &str,
    ) -> Result<Vec<[f32; N]>> {
        let (accessor, layout) = self.layout(index, at)?;
        if !(least..=N).contains(&layout.width) {
            return Err(self.error(at, format!("has {} numbers an element, not {N}", layout.width)));
        }
        let convert = converter(layout.component, layout.normalized);
        let size = layout.component.size();
        self.read(accessor, &layout, at, |element| {
            let mut out = fill;
            for (value, bytes) in out.iter_mut().zip(element.chunks_exact(size)) {
                *value = convert(bytes);
            }
            out
        })
    }

    /// Read elements of `N` unsigned integers, as for indices and joints.
    pub fn read_uints<const N: usize>(&self, index: usize, at: &str) -> Result<Vec<[u32; N]>> {
        let (accessor, layout) = self.layout(index, at)?;
        if layout.width != N || !layout.component.is_unsigned() {
            return Err(self.error(at, format!("must have {N} unsigned integers an element")));
        }
        let size = layout.component.size();
        self.read(accessor, &layout, at, |element| {
            let mut out = [0; N];
            for (value, bytes) in out.iter_mut().zip(element.chunks_exact(size)) {
                *value = unsigned_le(bytes);
            }
            out
        })
    }

    /// The primitive restart index, which begins another strip, loop or fan: the largest value of the accessor's type.
    pub fn restart(&self, index: usize, at: &str) -> Result<u32> {
        let (_, layout) = self.layout(index, at)?;
        Ok(u32::MAX >> (32 - 8 * layout.component.size().min(4)))
    }

    /// Number of elements that an accessor says it has.
    pub fn count(&self, index: usize, at: &str) -> Result<u64> {
        Ok(self.accessor(index, at)?.count.0)
    }

    fn accessor(&self, index: usize, at: &str) -> Result<&Accessor> {
        self.root.accessors.get(index).ok_or_else(|| self.error(at, format!("accessors[{index}] does not exist")))
    }

    fn layout(&self, index: usize, at: &str) -> Result<(&Accessor, Layout)> {
        let accessor = self.accessor(index, at)?;
        let double = self.doubles.contains(&index) && support::uses(self, support::DOUBLES);
        let (component, kind) = match (&accessor.component_type, &accessor.type_) {
            (Checked::Valid(component), Checked::Valid(kind)) => (Component::Core(component.0), kind),
            (Checked::Invalid, Checked::Valid(kind)) if double => (Component::Double, kind),
            _ => return Err(self.error(at, "has an unknown componentType or type")),
        };
        // Columns of matrices start at multiples of four bytes; only MAT4 occurs in what is read here, and its columns
        // of float do.
        if matches!(kind, Type::Mat2 | Type::Mat3) {
            return Err(self.error(at, "a 2×2 or 3×3 matrix is of no use here"));
        }
        let width = kind.multiplicity();
        let count = usize::try_from(accessor.count.0).map_err(|_| self.error(at, "has too many elements"))?;
        Ok((
            accessor,
            Layout { component, normalized: accessor.normalized, width, size: width * component.size(), count },
        ))
    }

    fn read<T: Copy>(
        &self,
        accessor: &Accessor,
        layout: &Layout,
        at: &str,
        element: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>> {
        let bytes = (layout.count as u64).saturating_mul(size_of::<T>() as u64);
        let mut out = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.unwrap_or_default().0;
                let run = Run { view: view.value(), offset, count: layout.count, size: layout.size };
                let elements = self.elements(run, true, at)?;
                self.charge(bytes, at)?;
                elements.map(&element).collect()
            }
            None => {
                if layout.count as u64 > MAX_ZEROS {
                    return Err(self.error(at, format!("{} elements without a buffer view", layout.count)));
                }
                self.charge(bytes, at)?;
                vec![element(&vec![0; layout.size]); layout.count]
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let count = usize::try_from(sparse.count.0).unwrap_or(usize::MAX);
            let Checked::Valid(kind) = &sparse.indices.component_type else {
                return Err(self.error(at, "has sparse indices of an unknown type"));
            };
            let (view, offset) = (sparse.indices.buffer_view.value(), sparse.indices.byte_offset.0);
            let indices = self.elements(Run { view, offset, count, size: kind.0.size() }, false, at)?;
            let (view, offset) = (sparse.values.buffer_view.value(), sparse.values.byte_offset.0);
            let values = self.elements(Run { view, offset, count, size: layout.size }, false, at)?;
            for (i, value) in indices.zip(values) {
                let i = unsigned_le(i);
                let slot = out.get_mut(i as usize);
                *slot
                    .ok_or_else(|| self.error(at, format!("sparse index {i} is beyond {} elements", layout.count)))? =
                    element(value);
            }
        }
        Ok(out)
    }

    /// The bytes of each element. If `strided`, they are as far apart as the view's stride. All are checked to be in range.
    fn elements(&self, run: Run, strided: bool, at: &str) -> Result<impl Iterator<Item = &[u8]>> {
        let Run { view, offset, count, size } = run;
        let view = self.view(view)?;
        let stride = view.stride.filter(|_| strided).unwrap_or(size);
        if stride < size {
            return Err(self.error(at, format!("elements of {size} bytes do not fit a stride of {stride}")));
        }
        let start = usize::try_from(offset).ok();
        let end = match count {
            0 => start,
            _ => (count - 1).checked_mul(stride).and_then(|n| n.checked_add(size)).and_then(|n| n.checked_add(start?)),
        };
        let bytes = start.zip(end).and_then(|(start, end)| view.bytes.get(start..end)).ok_or_else(|| {
            let what = format!("{count} elements from byte {offset} reach beyond a view of {} bytes", view.bytes.len());
            self.error(at, what)
        })?;
        // The last element may be shorter than the stride, never than `size`.
        Ok(bytes.chunks(stride.max(1)).map(move |chunk| &chunk[..size]))
    }
}

/// Elements in a row: `count` of `size` bytes, from byte `offset` of a view on.
struct Run {
    view: usize,
    offset: u64,
    count: usize,
    size: usize,
}

/// Little-endian, up to four bytes.
fn unsigned_le(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |n, &b| n << 8 | u32::from(b))
}

/// One stored number → float (glTF 2.0, 3.6.2.2: integers as they are, or normalised).
fn converter(component: Component, normalized: bool) -> fn(&[u8]) -> f32 {
    let Component::Core(component) = component else {
        // Eight bytes, as the layout has it.
        return |b| f64::from_bits(b.iter().rev().fold(0, |n, &b| n << 8 | u64::from(b))) as f32;
    };
    match (component, normalized) {
        (ComponentType::F32, _) => |b| f32::from_bits(unsigned_le(b)),
        (ComponentType::U8, true) => |b| unsigned_le(b) as f32 / 255.0,
        (ComponentType::U16, true) => |b| unsigned_le(b) as f32 / 65535.0,
        (ComponentType::U32, true) => |b| (f64::from(unsigned_le(b)) / 4_294_967_295.0) as f32,
        (ComponentType::I8, true) => |b| (f32::from(unsigned_le(b) as i8) / 127.0).max(-1.0),
        (ComponentType::I16, true) => |b| (f32::from(unsigned_le(b) as i16) / 32767.0).max(-1.0),
        (ComponentType::I8, false) => |b| f32::from(unsigned_le(b) as i8),
        (ComponentType::I16, false) => |b| f32::from(unsigned_le(b) as i16),
        (_, false) => |b| unsigned_le(b) as f32,
    }
}
