//! Reader of files: the head is read when a file is opened, and each page when its voxels are asked for.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use super::codes;
use super::codes::{Violation, require};
use super::head::Head;
use super::layout::{HEADER_LEN, NONE, SectionEntry, SectionKind};
use super::material::MixCoding;
use super::page;
use super::page::PageRef;
use super::stream::{Quantiser, canonical};
use super::{Channel, Limits, filter, open_file};
use crate::volume::octree::{PAGE_LOG2, Pages};
use crate::volume::{Depth, Info, Mix, Volume, Voxel};
use crate::{Error, Result, Warnings, par};

/// Decoded bytes of a node's voxel and child mask.
const NODE_BYTES: u64 = size_of::<Voxel>() as u64 + 1;
/// Decoded bytes of a node's mix of materials.
const MIX_BYTES: u64 = size_of::<Mix>() as u64;

/// Storage of a file's bytes.
enum Bytes {
    File(File),
    /// Bytes in memory, such as a buffer of a `.glb`.
    Memory(Arc<[u8]>),
}

impl Bytes {
    /// Fill `bytes` from `offset` on.
    fn read_at(&self, bytes: &mut [u8], offset: u64) -> Result<(), Violation> {
        let all = match self {
            Bytes::File(file) => return read_at(file, bytes, offset),
            Bytes::Memory(all) => all,
        };
        let part = usize::try_from(offset).ok().and_then(|from| all.get(from..from.checked_add(bytes.len())?));
        let what = || Violation { code: codes::FILE_LENGTH, offset, what: "it ends before this byte".into() };
        bytes.copy_from_slice(part.ok_or_else(what)?);
        Ok(())
    }
}

/// Fill `bytes` from `offset` on. The file is read and not mapped into memory. So if another program cuts it short meanwhile, that is
/// an error and not a signal that ends this program; and bytes that were checked cannot change.
fn read_at(file: &File, bytes: &mut [u8], offset: u64) -> Result<(), Violation> {
    #[cfg(unix)]
    let done = std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset);
    #[cfg(windows)]
    let done = {
        use std::os::windows::fs::FileExt;
        let mut filled = 0;
        loop {
            match file.seek_read(&mut bytes[filled..], offset + filled as u64) {
                Ok(0) if filled < bytes.len() => break Err(std::io::ErrorKind::UnexpectedEof.into()),
                Ok(n) if filled + n == bytes.len() => break Ok(()),
                Ok(n) => filled += n,
                Err(e) => break Err(e),
            }
        }
    };
    done.map_err(|e| Violation {
        code: codes::FILE_LENGTH,
        offset,
        what: format!("it became shorter, or cannot be read: {e}"),
    })
}

/// Index of a section's pages.
struct Index {
    refs: Vec<PageRef>,
    /// Whether each page was read before, so that its bytes are counted once.
    seen: Vec<AtomicBool>,
}

/// An open file. Cheap to open whatever the file's size; may be used by any number of threads.
pub struct Reader {
    path: PathBuf,
    bytes: Bytes,
    file_bytes: u64,
    head: Head,
    /// Made when the first page is decoded, since its tables take longer than all the rest of opening a file.
    quantiser: OnceLock<Quantiser>,
    /// For each stream of the quantiser, the index of the file's stream. Unknown streams and the mixes are not among them.
    voxel_streams: Vec<usize>,
    /// Index of the stream of mixes, and their coding; `None` where the texel has fewer than two materials.
    material: Option<(usize, MixCoding)>,
    /// Number of depths that are opened: those that are whole and within the limits.
    depths: usize,
    indices: Vec<OnceLock<Index>>,
    bytes_read: AtomicU64,
}

impl Reader {
    /// Open a file: read and check its head.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], and [`Error::Limit`] where not even the root is within the limits.
    pub fn open(path: impl AsRef<Path>, limits: &Limits) -> Result<Reader> {
        let reader = Reader::open_head(path.as_ref(), limits)?;
        reader.has_length(reader.file_bytes == reader.head.header.file_length)?;
        Ok(reader)
    }

    /// Open a file in memory; `name` stands for its path in messages.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn from_bytes(name: impl Into<PathBuf>, bytes: Arc<[u8]>, limits: &Limits) -> Result<Reader> {
        let length = bytes.len() as u64;
        let reader = Reader::from_source(name.into(), Bytes::Memory(bytes), length, limits)?;
        reader.has_length(reader.file_bytes == reader.head.header.file_length)?;
        Ok(reader)
    }

    /// [`Reader::open`] for a file that may be cut short, such as a download that broke off: depths that are not whole are not
    /// opened, and [`Reader::warnings`] says so.
    ///
    /// # Errors
    /// As [`Reader::open`]; `Format` where no depth is whole, or something follows the end.
    pub fn open_prefix(path: impl AsRef<Path>, limits: &Limits) -> Result<Reader> {
        let reader = Reader::open_head(path.as_ref(), limits)?;
        reader.has_length(reader.whole_depths() > 0 && reader.file_bytes <= reader.head.header.file_length)?;
        Ok(reader)
    }

    /// Require that the length of the file `is_right`.
    fn has_length(&self, is_right: bool) -> Result<()> {
        let (have, want) = (self.file_bytes, self.head.header.file_length);
        let advice = match self.whole_depths() {
            _ if have > want => "there is something after its end".to_owned(),
            0 => "no depth of it is whole".to_owned(),
            n => format!("its depths up to {} are whole: `vtex truncate --depth {}` keeps them", n - 1, n - 1),
        };
        require(is_right, codes::FILE_LENGTH, have.min(want), || {
            format!("it has {have} bytes where its header says {want}; {advice}")
        })
        .map_err(|b| b.at(&self.path))
    }

    /// The head of a file of any length, with those depths to be opened that are whole and within the limits.
    pub(super) fn open_head(path: &Path, limits: &Limits) -> Result<Reader> {
        let file = open_file(path)?;
        let file_bytes = file.metadata().map_err(|e| Error::io(path, e))?.len();
        Reader::from_source(path.to_path_buf(), Bytes::File(file), file_bytes, limits)
    }

    fn from_source(path: PathBuf, source: Bytes, file_bytes: u64, limits: &Limits) -> Result<Reader> {
        let fail = |b: Violation| b.at(&path);
        if file_bytes < HEADER_LEN as u64 {
            let what = format!("it has only {file_bytes} bytes");
            return Err(fail(Violation { code: codes::MAGIC, offset: 0, what }));
        }
        let mut start = [0; HEADER_LEN];
        source.read_at(&mut start, 0).map_err(fail)?;
        let length = Head::length(&start).map_err(fail)?;
        if file_bytes < length as u64 {
            let what = format!("it is cut short after {file_bytes} bytes, within its head");
            return Err(fail(Violation { code: codes::FILE_LENGTH, offset: file_bytes, what }));
        }
        let mut bytes = vec![0; length];
        source.read_at(&mut bytes, 0).map_err(fail)?;
        let head = Head::parse(&bytes).map_err(fail)?;

        let material = head.streams.iter().position(|s| s.channel() == Some(Channel::Material));
        let material = material.map(|s| (s, MixCoding::new(&head.info.materials)));
        let node_bytes = NODE_BYTES + if material.is_some() { MIX_BYTES } else { 0 };
        let (mut depths, mut bytes) = (0, 0u64);
        for depth in &head.depths {
            bytes += depth.nodes * node_bytes;
            if bytes > limits.decoded_bytes || depth.block_end > file_bytes {
                break;
            }
            depths += 1;
        }
        if depths == 0 && bytes > limits.decoded_bytes {
            return Err(Error::Limit {
                what: format!("{}: the coarsest depth", path.display()),
                needed: bytes,
                allowed: limits.decoded_bytes,
            });
        }
        let voxel_streams: Vec<usize> = (0..head.streams.len())
            .filter(|&s| head.streams[s].channel().is_some_and(|c| c != Channel::Material))
            .collect();
        Ok(Reader {
            indices: head.sections.iter().map(|_| OnceLock::new()).collect(),
            bytes_read: AtomicU64::new(length as u64),
            quantiser: OnceLock::new(),
            voxel_streams,
            material,
            depths,
            head,
            path,
            bytes: source,
            file_bytes,
        })
    }

    fn quantiser(&self) -> &Quantiser {
        self.quantiser.get_or_init(|| {
            Quantiser::of(self.voxel_streams.iter().filter_map(|&s| {
                let stream = &self.head.streams[s];
                Some((stream.channel()?, stream.quant_max as u8))
            }))
        })
    }

    /// Head of the file.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// Bytes of each depth's block, see [`Head::depth_sizes`].
    pub fn depth_sizes(&self) -> Vec<u64> {
        self.head.depth_sizes()
    }

    /// Bytes of each channel, see [`Head::channel_sizes`].
    pub fn channel_sizes(&self) -> Vec<(&'static str, u64)> {
        self.head.channel_sizes()
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of bytes of the file that were read so far, each counted once however often it was read.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// Number of depths whose bytes are all there, counted from the root.
    pub fn whole_depths(&self) -> usize {
        self.head.depths.iter().take_while(|d| d.block_end <= self.file_bytes).count()
    }

    /// Warnings about what was left out.
    pub fn warnings(&self) -> Warnings {
        let mut warnings = Warnings::default();
        let (all, whole) = (self.head.depths.len(), self.whole_depths());
        let (path, have, want) = (self.path.display(), self.file_bytes, self.head.header.file_length);
        if have < want {
            let which =
                if whole == all { "all its depths".into() } else { format!("its depths up to {}", whole.max(1) - 1) };
            warnings.add(format!("{path}: is cut short after {have} of {want} bytes; {which} are whole and are read"));
        }
        if self.depths < whole {
            let left = whole - self.depths;
            warnings.add(format!(
                "{path}: the finest {left} of {all} depths are beyond the memory limit and are not opened"
            ));
        }
        warnings
    }

    /// Read all depths that are opened into memory.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Format`] on the first page that cannot be read.
    pub fn read_all(&self) -> Result<Volume> {
        let mut depths = Vec::with_capacity(self.depths);
        for (d, n) in self.counts().into_iter().enumerate() {
            let pages = par::map(n.div_ceil(1 << PAGE_LOG2), |page| Ok((self.voxels(d, page)?, self.mixes(d, page)?)));
            let (mut voxels, mut mixes) = (Vec::new(), Vec::new());
            for page in pages {
                let (page, mixed) = page?;
                voxels.extend(page);
                mixes.extend(mixed);
            }
            depths.push(Depth { masks: self.masks(d)?, voxels, mixes });
        }
        Ok(Volume { info: self.head.info.clone(), depths })
    }

    /// Read `length` bytes from `offset` on, without counting them in [`Reader::bytes_read`].
    pub(super) fn read(&self, offset: u64, length: u64) -> Result<Vec<u8>, Violation> {
        let end = offset.checked_add(length).filter(|&end| end <= self.file_bytes);
        require(end.is_some(), codes::FILE_LENGTH, offset, || "a section ends after the end of the file".into())?;
        let mut bytes = vec![0; length as usize];
        self.bytes.read_at(&mut bytes, offset)?;
        Ok(bytes)
    }

    /// Section of `kind` at `depth` for `stream`, with its index in the section table.
    fn section(&self, kind: SectionKind, depth: usize, stream: u8) -> Option<(usize, &SectionEntry)> {
        let wanted = |s: &SectionEntry| s.kind == kind && usize::from(s.depth) == depth && s.stream == stream;
        self.head.sections.iter().enumerate().find(|(_, s)| wanted(s))
    }

    fn index(&self, number: usize, section: &SectionEntry) -> Result<&Index, Violation> {
        if let Some(index) = self.indices[number].get() {
            return Ok(index);
        }
        let bytes = self.read(section.offset, section.index_len())?;
        let refs = page::parse_index(section, &bytes)?;
        Ok(self.indices[number].get_or_init(|| {
            self.bytes_read.fetch_add(section.index_len(), Ordering::Relaxed);
            Index { seen: refs.iter().map(|_| AtomicBool::new(false)).collect(), refs }
        }))
    }

    /// Decoded codes of page `number` of a section: `nodes` nodes, whose component k is at most `most[k]`. Empty where the section has
    /// no such page.
    fn page(
        &self,
        section: &SectionEntry,
        index: &Index,
        number: usize,
        nodes: u64,
        most: &[u8],
    ) -> Result<Vec<u8>, Violation> {
        let (Some(page), Some(seen)) = (index.refs.get(number), index.seen.get(number)) else {
            return Ok(Vec::new());
        };
        let offset = section.offset + page.offset;
        let bytes = self.read(offset, page.length.into())?;
        if !seen.swap(true, Ordering::Relaxed) {
            self.bytes_read.fetch_add(page.length.into(), Ordering::Relaxed);
        }
        let mut codes = page::decode(&bytes, page.crc, section.codec, nodes as usize * most.len(), offset)?;
        require(filter::inverse(section.filter, &mut codes, most), codes::PAGE_VALUE, offset, || {
            format!("a page has codes above {most:?}, the most that its stream allows")
        })?;
        Ok(codes)
    }

    /// Codes of page `page` of stream `stream` of the file.
    pub(super) fn stream_page(&self, depth: usize, stream: usize, page: usize) -> Result<Vec<u8>, Violation> {
        let Some((number, section)) = self.section(SectionKind::Page, depth, stream as u8) else {
            return Ok(Vec::new());
        };
        let entry = &self.head.streams[stream];
        let page_log2 = self.head.header.page_log2;
        let index = self.index(number, section)?;
        let left = self.head.depths[depth].nodes.saturating_sub((page as u64) << page_log2);
        let codes = self.page(section, index, page, left.min(1 << page_log2), &entry.maxima())?;
        if let Some((_, coding)) = self.material.as_ref().filter(|m| m.0 == stream) {
            let whole = codes.chunks_exact(entry.components.into()).all(|c| coding.is_whole(c));
            require(whole, codes::PAGE_VALUE, section.offset, || "shares of materials sum up to more than all".into())?;
        }
        Ok(codes)
    }

    /// Mixes of the voxels in page `page` (of 4096 voxels) of `depth`.
    fn read_mixes(&self, depth: usize, page: usize) -> Result<Vec<Mix>, Violation> {
        let Some((stream, coding)) = &self.material else { return Ok(Vec::new()) };
        // The coding of a mix depends on the voxel's colour.
        let (quantiser, mut voxels) = (self.quantiser(), vec![Voxel::default(); self.nodes_in_page(depth, page)]);
        let albedo = |&(_, &s): &(usize, &usize)| self.head.streams[s].channel() == Some(Channel::Albedo);
        if let Some((slot, &stream)) = self.voxel_streams.iter().enumerate().find(albedo) {
            self.for_each_codes(depth, stream, page, |i, codes| quantiser.put(slot, &mut voxels[i], codes))?;
        }
        let mut mixes = vec![Mix::default(); voxels.len()];
        self.for_each_codes(depth, *stream, page, |i, codes| {
            mixes[i] = coding.mix(codes, voxels[i].albedo).unwrap_or_default()
        })?;
        Ok(mixes)
    }

    /// Page `page` of the child masks of the nodes at `depth` − 1.
    pub(super) fn topo_page(&self, depth: usize, page: usize) -> Result<Vec<u8>, Violation> {
        let Some((number, section)) = self.section(SectionKind::Topo, depth, NONE) else { return Ok(Vec::new()) };
        let index = self.index(number, section)?;
        let refs = &index.refs;
        let Some(at) = refs.get(page) else { return Ok(Vec::new()) };
        let page_log2 = self.head.header.topo_page_log2;
        let left = self.head.depths[depth - 1].nodes - ((page as u64) << page_log2);
        let masks = self.page(section, index, page, left.min(1 << page_log2), &[u8::MAX])?;
        let children: u64 = masks.iter().map(|m| u64::from(m.count_ones())).sum();
        let next = refs.get(page + 1).map_or(self.head.depths[depth].nodes, |next| next.first_child);
        let first = if page == 0 { 0 } else { at.first_child };
        require(
            at.first_child == first && next.checked_sub(first) == Some(children),
            codes::TOPOLOGY,
            section.offset,
            || {
                format!(
                    "{children} children of page {page} at depth {} do not lead from rank {first} to {next}",
                    depth - 1
                )
            },
        )?;
        Ok(masks)
    }

    /// Child masks of every node at `depth`, with their sum checked against the counts.
    fn read_masks(&self, depth: usize) -> Result<Vec<u8>, Violation> {
        let entry = &self.head.depths[depth];
        if depth + 1 >= self.depths {
            return Ok(vec![0; entry.nodes as usize]);
        }
        let mut masks = Vec::new();
        for page in 0..entry.nodes.div_ceil(1 << self.head.header.topo_page_log2) {
            masks.extend(self.topo_page(depth + 1, page as usize)?);
        }
        let internal = masks.iter().filter(|&&m| m != 0).count() as u64;
        require(internal == entry.internal, codes::TOPOLOGY, self.head.depths[depth + 1].block_offset, || {
            format!("depth {depth} has {internal} nodes with children, its entry says {}", entry.internal)
        })?;
        Ok(masks)
    }

    /// Voxels `page << 12 ..` of `depth`, whatever the size of the file's pages.
    fn read_voxels(&self, depth: usize, page: usize) -> Result<Vec<Voxel>, Violation> {
        let (quantiser, mut voxels) = (self.quantiser(), vec![Voxel::default(); self.nodes_in_page(depth, page)]);
        for (slot, &stream) in self.voxel_streams.iter().enumerate() {
            self.for_each_codes(depth, stream, page, |i, codes| quantiser.put(slot, &mut voxels[i], codes))?;
        }
        voxels.iter_mut().for_each(|v| *v = canonical(v));
        Ok(voxels)
    }

    /// Number of nodes in page `page` (of 4096) of `depth`.
    fn nodes_in_page(&self, depth: usize, page: usize) -> usize {
        (self.head.depths[depth].nodes as usize).saturating_sub(page << PAGE_LOG2).min(1 << PAGE_LOG2)
    }

    /// Call `each` with the index and the codes of every voxel in page `page` (of 4096) of `depth`. The file's own pages may have
    /// another size.
    fn for_each_codes(
        &self,
        depth: usize,
        stream: usize,
        page: usize,
        mut each: impl FnMut(usize, &[u8]),
    ) -> Result<(), Violation> {
        let entry = &self.head.streams[stream];
        let (components, page_log2) = (usize::from(entry.components), self.head.header.page_log2);
        let (first, count) = (page << PAGE_LOG2, self.nodes_in_page(depth, page));
        if entry.is_constant() {
            (0..count).for_each(|i| each(i, &entry.constant[..components]));
            return Ok(());
        }
        let mut done = 0;
        while done < count {
            let (file_page, skip) = ((first + done) >> page_log2, (first + done) & ((1 << page_log2) - 1));
            let codes = self.stream_page(depth, stream, file_page)?;
            let codes = codes.get(skip * components..).unwrap_or_default().chunks_exact(components);
            let before = done;
            for codes in codes.take(count - done) {
                each(done, codes);
                done += 1;
            }
            if done == before {
                break;
            }
        }
        Ok(())
    }
}

impl Pages for Reader {
    fn info(&self) -> &Info {
        &self.head.info
    }

    fn counts(&self) -> Vec<usize> {
        self.head.depths[..self.depths].iter().map(|d| d.nodes as usize).collect()
    }

    fn masks(&self, depth: usize) -> Result<Vec<u8>> {
        if depth >= self.depths {
            return Ok(Vec::new());
        }
        self.read_masks(depth).map_err(|b| b.at(&self.path))
    }

    fn voxels(&self, depth: usize, page: usize) -> Result<Vec<Voxel>> {
        if depth >= self.depths {
            return Ok(Vec::new());
        }
        self.read_voxels(depth, page).map_err(|b| b.at(&self.path))
    }

    fn mixes(&self, depth: usize, page: usize) -> Result<Vec<Mix>> {
        if depth >= self.depths {
            return Ok(Vec::new());
        }
        self.read_mixes(depth, page).map_err(|b| b.at(&self.path))
    }
}
