//! The table of what the spine must show: `cargo bench --bench spine [-- WORD…]` runs the rows whose names hold a word.
//!
//! Bakes the sample tree at 512^3 and 1024^3 and a mesh of a million triangles, and renders 512 trees from near and
//! 25 000 from afar at 1280×720 with shadows; each by the command, in a process of its own, so that its memory is its own.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// What a process took.
struct Cost {
    wall: f64,
    cpu: f64,
    peak: u64,
    output: String,
}

fn main() -> Outcome<()> {
    let words: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wanted = |name: &str| words.is_empty() || words.iter().any(|w| name.contains(w.as_str()));
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("spine");
    std::fs::create_dir_all(&dir)?;
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/tree.glb").display().to_string();
    println!("{} threads; seconds are wall-clock and CPU, memory is the process's peak", cores());
    println!("{:<34} {:>8} {:>8} {:>9}  of", "what", "wall s", "CPU s", "peak MiB");

    let texel = dir.join("tree-512.vtex");
    if wanted("bake tree 512") || !texel.exists() {
        bake("bake tree 512", &dir, &tree, &texel, "512", "≤ 10 s, ≤ 1024 MiB, ≤ 64 bits")?;
    }
    if wanted("bake tree 1024") {
        bake("bake tree 1024", &dir, &tree, &dir.join("tree-1024.vtex"), "1024", "≤ 4096 MiB")?;
    }
    if wanted("bake 1 M triangles 512") {
        let mesh = dir.join("million.gltf");
        let side = 708;
        grid(&mesh, side, 10.0, |x, z| 0.4 * (3.1 * x).sin() * (2.3 * z).cos() + 0.05 * (31.0 * x + 17.0 * z).sin())?;
        let name = format!("bake {} triangles 512", 2 * side * side);
        bake(&name, &dir, &mesh.display().to_string(), &dir.join("million.vtex"), "512", "≤ 20 s")?;
    }
    if wanted("bake solid of 1 M triangles 512") {
        let mesh = dir.join("solid.gltf");
        let triangles = solid(&mesh, 500, 1000)?;
        let name = format!("bake solid of {triangles} 512");
        bake(&name, &dir, &mesh.display().to_string(), &dir.join("solid.vtex"), "512", "≤ 20 s")?;
    }
    if wanted("render 512 trees near") {
        // 1024 patches of ten metres, every other one with a tree.
        let land = dir.join("flat.gltf");
        grid(&land, 32, 320.0, |_, _| 0.0)?;
        let out = dir.join("near.gltf");
        map(&dir, &land, &texel, &out, &["--presence", "0.5", "--repeat", "32"])?;
        let eye = ["--eye", "0,9,-5", "--look-at", "0,3,-40", "--fov", "50"];
        render("render 512 trees near", &dir, &out, &eye, "≤ 5 s, ≤ 200 MiB")?;
    }
    if wanted("render 25 000 trees far") {
        let land = dir.join("hills.gltf");
        let hills = |x: f64, z: f64| 40.0 * (x / 170.0).sin() * (z / 210.0).cos() + 12.0 * (x / 61.0 + z / 83.0).sin();
        grid(&land, 158, 1580.0, hills)?;
        let out = dir.join("far.gltf");
        map(&dir, &land, &texel, &out, &["--repeat", "158"])?;
        let eye = ["--eye", "0,330,1250", "--look-at", "0,0,-100", "--fov", "50"];
        render("render 25 000 trees far", &dir, &out, &eye, "≤ 5 s, ≤ 200 MiB, < 10 % read")?;
    }
    Ok(())
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

fn row(name: &str, cost: &Cost, more: &str, goal: &str) {
    let mib = cost.peak as f64 / f64::from(1 << 20);
    println!("{name:<34} {:>8.2} {:>8.2} {mib:>9.0}  {more} (goal {goal})", cost.wall, cost.cpu);
}

fn bake(name: &str, dir: &Path, source: &str, output: &Path, resolution: &str, goal: &str) -> Outcome<()> {
    let out = output.display().to_string();
    let cost = vtex(dir, &["bake", source, "-r", resolution, "-o", &out, "--quiet"])?;
    let seen = vtex(dir, &["inspect", &out, "--json"])?;
    let seen: Value = serde_json::from_str(&seen.output)?;
    let figure = |key: &str| seen[key].as_f64().unwrap_or(f64::NAN);
    let (voxels, bits, bytes) = (figure("finest_voxels"), figure("bits_per_finest_voxel"), figure("file_bytes"));
    row(name, &cost, &format!("{voxels:.0} voxels, {bits:.1} bits each, {:.2} MB", bytes / 1e6), goal);
    Ok(())
}

fn map(dir: &Path, land: &Path, texel: &Path, output: &Path, more: &[&str]) -> Outcome<()> {
    let [land, texel, output] = [land, texel, output].map(|p| p.display().to_string());
    vtex(dir, &[&["map", &land, "--bend", "--texel", &texel, "-o", &output, "--quiet"], more].concat())?;
    Ok(())
}

fn render(name: &str, dir: &Path, scene: &Path, eye: &[&str], goal: &str) -> Outcome<()> {
    let (scene, picture) = (scene.display().to_string(), scene.with_extension("png").display().to_string());
    let args = ["render", &scene, "-o", &picture, "--size", "1280x720", "--stats", "--json", "--quiet"];
    let cost = vtex(dir, &[&args, eye].concat())?;
    let stats: Value = serde_json::from_str(&cost.output)?;
    let figure = |key: &str| stats[key].as_f64().unwrap_or(f64::NAN);
    let share = 100.0 * figure("bytes_read") / figure("bytes_in_files");
    let rays = figure("shadow_rays");
    row(name, &cost, &format!("{share:.1} % of .vtex read, {rays:.0} shadow rays",), goal);
    Ok(())
}

/// Run the command to its end; an error with its last words if it fails.
fn vtex(dir: &Path, args: &[&str]) -> Outcome<Cost> {
    let start = Instant::now();
    let output = dir.join("output.txt");
    let mut child = Command::new(env!("CARGO_BIN_EXE_vtex"))
        .args(args)
        .stdin(Stdio::null())
        .stdout(std::fs::File::create(&output)?)
        .stderr(Stdio::inherit())
        .spawn()?;
    let process = PathBuf::from(format!("/proc/{}", child.id()));
    let (mut peak, mut cpu) = (0, 0.0);
    let status = loop {
        // Linux keeps both until the process is waited for; elsewhere they stay 0.
        peak = peak_memory(&process).unwrap_or(0).max(peak);
        cpu = f64::max(cpu_seconds(&process).unwrap_or(0.0), cpu);
        if let Some(status) = child.try_wait()? {
            break status;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let wall = start.elapsed().as_secs_f64();
    if !status.success() {
        return Err(format!("vtex {}: {status}", args.join(" ")).into());
    }
    Ok(Cost { wall, cpu, peak, output: std::fs::read_to_string(&output)? })
}

fn peak_memory(process: &Path) -> Option<u64> {
    let status = std::fs::read_to_string(process.join("status")).ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|k| k * 1024)
}

/// User and system time; a clock tick is a hundredth of a second on every Linux of today.
fn cpu_seconds(process: &Path) -> Option<f64> {
    let stat = std::fs::read_to_string(process.join("stat")).ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: f64 = [11, 12].iter().filter_map(|&k| fields.get(k)?.parse::<f64>().ok()).sum();
    Some(ticks / 100.0)
}

/// A closed, rough sphere of `rings` × `around` squares; gives its triangles.
fn solid(path: &Path, rings: u32, around: u32) -> Outcome<u32> {
    let mut positions = Vec::new();
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    let mut corner = |theta: f64, phi: f64| {
        let (x, y, z) = (theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
        let r = 1.0
            + 0.1 * (5.0 * x + 1.0).sin() * (4.0 * y).cos()
            + 0.03 * (23.0 * x + 11.0 * z).sin()
            + 0.01 * (61.0 * y + 47.0 * z).sin();
        let p = [x, y, z].map(|v| (r * v) as f32);
        for k in 0..3 {
            (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
        }
        positions.extend(p.map(f32::to_le_bytes));
    };
    corner(0.0, 0.0);
    for i in 1..rings {
        for j in 0..around {
            let angle = |n: u32, of: u32| std::f64::consts::PI * f64::from(n) / f64::from(of);
            corner(angle(i, rings), 2.0 * angle(j, around));
        }
    }
    corner(std::f64::consts::PI, 0.0);
    let last = (rings - 1) * around + 1;
    let at = |i: u32, j: u32| match i {
        0 => 0,
        i if i == rings => last,
        i => 1 + (i - 1) * around + j % around,
    };
    let squares = (0..rings).flat_map(|i| (0..around).map(move |j| (i, j)));
    let indices: Vec<[u8; 4]> = squares
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .filter(|t| t[0] != t[1] && t[1] != t[2] && t[0] != t[2])
        .flatten()
        .map(u32::to_le_bytes)
        .collect();
    let (positions, corners) = (positions.concat(), indices.len());
    let bin = path.with_extension("bin");
    std::fs::write(&bin, [&positions[..], &indices.concat()].concat())?;
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": bin.file_name().and_then(|n| n.to_str()), "byteLength": positions.len() + 4 * corners}],
        "bufferViews": [
            {"buffer": 0, "byteLength": positions.len()},
            {"buffer": 0, "byteOffset": positions.len(), "byteLength": 4 * corners}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": positions.len() / 12, "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5125, "count": corners, "type": "SCALAR"}],
    });
    std::fs::write(path, file.to_string())?;
    Ok(corners as u32 / 3)
}

/// A height field of `side`^2 squares over `size` metres, with texture coordinates over the unit square.
fn grid(path: &Path, side: u32, size: f64, height: impl Fn(f64, f64) -> f64) -> Outcome<()> {
    let n = side + 1;
    let at = |k: u32| size * (f64::from(k) / f64::from(side) - 0.5);
    let (mut positions, mut uvs, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for j in 0..n {
        for i in 0..n {
            let y = height(at(i), at(j)) as f32;
            (low, high) = (low.min(y), high.max(y));
            positions.extend([at(i) as f32, y, at(j) as f32].map(f32::to_le_bytes));
            uvs.extend([i as f32 / side as f32, j as f32 / side as f32].map(f32::to_le_bytes));
            if i < side && j < side {
                let a = j * n + i;
                indices.extend([a, a + n, a + n + 1, a, a + n + 1, a + 1].map(u32::to_le_bytes));
            }
        }
    }
    let bytes = [positions.concat(), uvs.concat(), indices.concat()];
    let bin = path.with_extension("bin");
    std::fs::write(&bin, bytes.concat())?;
    let mut offset = 0;
    let views = bytes.each_ref().map(|b| {
        let view = json!({"buffer": 0, "byteOffset": offset, "byteLength": b.len()});
        offset += b.len();
        view
    });
    let (edge, count) = (size as f32 / 2.0, n * n);
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"rotation": [-0.4, 0.25, 0.1, 0.876], "extensions": {"KHR_lights_punctual": {"light": 0}}}],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 3.0}]}},
        "materials": [{"name": "ground", "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.1, 0.05, 1.0]}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "buffers": [{"uri": bin.file_name().and_then(|n| n.to_str()), "byteLength": offset}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3",
                "min": [-edge, low, -edge], "max": [edge, high, edge]},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5125, "count": 6 * side * side, "type": "SCALAR"}],
    });
    std::fs::write(path, file.to_string())?;
    Ok(())
}
