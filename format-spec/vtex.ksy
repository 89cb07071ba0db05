meta:
  id: vtex
  title: Volumetric texture (.vtex) 1.0, structure only (pages are opaque)
  file-extension: vtex
  endian: le
  ks-version: '0.11'
doc: |
  Structural description: everything except the decoded content of pages.
  Kaitai checks magic, versions and enumerations; the MUSTs about sums, order,
  non-overlap and checksums are in the normative text and in the independent reader.
seq:
  - id: header
    type: header
  - id: depths
    type: depth_entry
    repeat: expr
    repeat-expr: header.num_depths
  - id: streams
    type: stream_entry
    repeat: expr
    repeat-expr: header.num_streams
  - id: sections
    type: section_entry
    repeat: expr
    repeat-expr: header.num_sections
types:
  header:
    seq:
      - id: magic
        contents: [0xab, "VTEX 1", 0xbb, 0x0d, 0x0a, 0x1a, 0x0a]
      - {id: version_major, type: u2, valid: 1}
      - {id: version_minor, type: u2}
      - {id: len_head, type: u4, valid: {min: 240, max: 1048576}}
      - {id: head_crc32, type: u4}
      - {id: len_file, type: u8}
      - {id: incompat_flags, type: u4, valid: 0}
      - {id: compat_flags, type: u4}
      - {id: num_depths, type: u1, valid: {min: 1, max: 17}}
      - {id: num_streams, type: u1, valid: {min: 1, max: 32}}
      - {id: page_log2, type: u1, valid: {min: 10, max: 16}}
      - {id: topo_page_log2, type: u1, valid: {min: 10, max: 16}}
      - {id: cyclic_axes, type: u1, valid: {max: 7}}
      - {id: up_axis, type: u1, valid: {max: 2}}
      - {id: num_sections, type: u2, valid: {min: 1, max: 4096}}
      - id: bounds
        type: f8
        repeat: expr
        repeat-expr: 6
        valid: {expr: '_ - _ == 0'}
        doc: finite, as nothing else gives 0 when it is taken from itself
      - {id: metres_per_unit, type: f8, valid: {expr: '_ >= 0 and _ - _ == 0'}}
      - {id: num_nodes, type: u8}
      - {id: content_id, size: 16}
  depth_entry:
    seq:
      - {id: num_nodes, type: u8, valid: {max: 4294967294}}
      - {id: num_internal, type: u8, valid: {max: num_nodes}}
      - {id: ofs_block, type: u8}
      - {id: end_block, type: u8, doc: a prefix of this many bytes holds depths 0..this}
      - {id: digest_sha256, size: 32}
  stream_entry:
    seq:
      - {id: semantic, type: str, size: 4, encoding: ASCII, doc: 'RATE NDFD NDFC CORR SUPP SIDE MEAN ALBD MATL; others are skipped unless critical'}
      - {id: num_components, type: u1, valid: {min: 1, max: 8}}
      - {id: len_component, type: u1, valid: 1}
      - {id: quant_max, type: u2, valid: {min: 1, max: 255}}
      - {id: flags, type: u2, valid: {max: 7}}
      - {id: reserved, type: u2, valid: 0}
      - {id: max_abs_error, type: f4, valid: {expr: '_ >= 0 and _ - _ == 0'}}
      - {id: constant, size: 8}
      - {id: reserved_tail, contents: [0, 0, 0, 0, 0, 0, 0, 0]}
  section_entry:
    seq:
      - {id: kind, type: str, size: 4, encoding: ASCII}
      - {id: flags, type: u2, valid: {max: 3}}
      - {id: depth, type: u1}
      - {id: stream, type: u1}
      - {id: ofs_body, type: u8}
      - {id: len_body, type: u8}
      - {id: len_decoded, type: u8}
      - {id: num_pages, type: u4}
      - {id: crc32, type: u4}
      - {id: codec, type: u1, enum: codec, valid: {in-enum: true}}
      - {id: filter, type: u1, enum: filter, valid: {in-enum: true}}
      - {id: reserved, contents: [0, 0, 0, 0, 0, 0]}
    instances:
      body:
        io: _root._io
        pos: ofs_body
        size: len_body
        type:
          switch-on: kind
          cases:
            '"META"': meta_json
            '"TOPO"': topo_body(num_pages)
            '"PAGE"': page_body(num_pages)
  meta_json:
    seq: [{id: json, type: str, size-eos: true, encoding: UTF-8}]
  topo_body:
    params: [{id: num_pages, type: u4}]
    seq: [{id: index, type: topo_ref, repeat: expr, repeat-expr: num_pages}]
  page_body:
    params: [{id: num_pages, type: u4}]
    seq: [{id: index, type: page_ref, repeat: expr, repeat-expr: num_pages}]
  topo_ref:
    seq:
      - {id: ofs_page, type: u8}
      - {id: len_page, type: u4}
      - {id: crc32, type: u4}
      - {id: first_child, type: u8}
  page_ref:
    seq:
      - {id: ofs_page, type: u8}
      - {id: len_page, type: u4}
      - {id: crc32, type: u4}
enums:
  codec: {0: none, 1: zstd}
  filter: {0: interleaved, 1: planes, 2: planes_delta}
