//! What a bench looks at: each scene is hard in its own way.

/// Where the matter comes from.
#[derive(Clone, Copy)]
pub enum Matter {
    /// A built-in sample.
    Sample(&'static str),
    /// One of [`crate::cli::shapes`].
    Shape(fn() -> crate::cli::shapes::Shape),
}

/// How it is laid out.
#[derive(Clone, Copy)]
pub enum Layout {
    /// One object that fills the frame.
    Alone,
    /// `side`^2 cells of ten metres with a share of trees, seen from `eye` towards `target`.
    Forest { side: u32, hilly: bool, presence: f64, eye: [f64; 3], target: [f64; 3], hedge: bool },
    /// `side`^2 trees that stand close, each in a shell of its own or a rigid copy.
    Stands { side: u32, rigid: bool, hilly: bool, eye: [f64; 3], target: [f64; 3] },
    /// `cells`^2 trees in one shell over hills of `side`^2 squares, whatever their number.
    Cut { side: u32, cells: u32, eye: [f64; 3], target: [f64; 3] },
}

pub struct Place {
    pub name: &'static str,
    pub about: &'static str,
    pub matter: Matter,
    pub layout: Layout,
    /// Voxels a side, for a square picture of 128 pixels of one object, or for any landscape.
    pub resolution: u32,
    pub quick: bool,
    /// Measured only where it is asked for by its name, since its reference takes long.
    pub on_request: bool,
}

const fn alone(name: &'static str, about: &'static str, matter: Matter, resolution: u32, quick: bool) -> Place {
    Place { name, about, matter, layout: Layout::Alone, resolution, quick, on_request: false }
}

const TREE: Matter = Matter::Sample("tree.glb");

const fn stands(name: &'static str, about: &'static str, resolution: u32, layout: Layout) -> Place {
    Place { name, about, matter: TREE, layout, resolution, quick: false, on_request: true }
}

const FAR: Layout =
    Layout::Stands { side: 158, rigid: false, hilly: true, eye: [0.0, 200.0, 760.0], target: [0.0, 0.0, -60.0] };
const NEAR: Layout =
    Layout::Stands { side: 23, rigid: false, hilly: false, eye: [0.0, 9.0, -5.0], target: [0.0, 3.0, -40.0] };
const MILLION: Layout =
    Layout::Stands { side: 1000, rigid: false, hilly: true, eye: [0.0, 200.0, 3000.0], target: [0.0, 0.0, 0.0] };

/// The same with rigid copies.
const fn rigid(layout: Layout) -> Layout {
    match layout {
        Layout::Stands { side, hilly, eye, target, .. } => Layout::Stands { side, rigid: true, hilly, eye, target },
        other => other,
    }
}

pub const SCENES: [Place; 21] = [
    alone("tree", "one tree, pixel = voxel", TREE, 128, true),
    alone("tree-half", "one tree, pixel = 1/2 voxel", TREE, 64, false),
    alone("tree-quarter", "one tree, pixel = 1/4 voxel", TREE, 32, false),
    alone("tree-four", "one tree, 4 voxels a pixel", TREE, 512, false),
    alone("sheet", "a thin sheet", Matter::Shape(crate::cli::shapes::sheet), 128, true),
    alone("solid", "a ball", Matter::Shape(crate::cli::shapes::ball), 128, false),
    alone("blinds", "slats seen through", Matter::Shape(crate::cli::shapes::blinds), 128, false),
    alone("fur", "hairs thinner than a voxel", Matter::Shape(crate::cli::shapes::fur), 128, false),
    alone(
        "leaves",
        "leaves in all directions",
        Matter::Shape(|| crate::cli::shapes::leaves("leaves", 3.0, 1.5)),
        128,
        false,
    ),
    alone("clumps", "clumps of leaves smaller than a voxel", Matter::Shape(crate::cli::shapes::clumps), 128, false),
    alone("spruce", "a tree of alpha-masked cards", Matter::Sample("spruce.glb"), 128, false),
    alone("fern", "a fern of alpha-masked cards", Matter::Sample("fern.glb"), 128, true),
    Place {
        name: "near",
        about: "512 trees from near",
        matter: TREE,
        layout: Layout::Forest {
            side: 32,
            hilly: false,
            presence: 0.5,
            eye: [0.0, 9.0, -5.0],
            target: [0.0, 3.0, -40.0],
            hedge: false,
        },
        resolution: 512,
        quick: true,
        on_request: false,
    },
    Place {
        name: "far",
        about: "25 000 trees from afar",
        matter: TREE,
        layout: Layout::Forest {
            side: 158,
            hilly: true,
            presence: 1.0,
            eye: [0.0, 330.0, 1250.0],
            target: [0.0, 0.0, -100.0],
            hedge: false,
        },
        resolution: 512,
        quick: true,
        on_request: false,
    },
    Place {
        name: "layered",
        about: "trees behind trees behind a hedge",
        matter: TREE,
        layout: Layout::Forest {
            side: 32,
            hilly: false,
            presence: 0.7,
            eye: [0.0, 2.0, 164.0],
            target: [0.0, 4.0, 100.0],
            hedge: true,
        },
        resolution: 512,
        quick: false,
        on_request: false,
    },
    stands("own-far", "25 000 trees from afar, each a shell of its own, boxes overlapping", 256, FAR),
    stands("own-near", "529 trees from near, each a shell of its own", 512, NEAR),
    stands("own-million", "1 000 000 trees to the horizon, each a shell of its own", 256, MILLION),
    stands("copies-far", "25 000 rigid copies from afar, as own-far", 256, rigid(FAR)),
    stands("copies-near", "529 rigid copies from near, as own-near", 512, rigid(NEAR)),
    stands("copies-million", "1 000 000 rigid copies to the horizon, as own-million", 256, rigid(MILLION)),
];
