// The triangles of a landscape traced by Embree: the picture that vtex makes of texels, and what it costs.
//
// Based on: I. Wald, S. Woop, C. Benthin, G. Johnson, M. Ernst, *Embree: A Kernel Framework for Efficient CPU Ray Tracing*, TOG
// 2014; J. Hanika, *Hacking the Shadow Terminator*, Ray Tracing Gems II, 2021.
//
// The landscape is what `vtex bench --peer` writes (src/cli/bench/peer.rs says how): meshes once, copies as matrices, one sun,
// a constant sky, a camera. One bounce: the sun with a hard shadow, and the sky, unshadowed; box filter, linear light. Samples
// are those of `vtex render --reference`, so that the two pictures can be compared pixel by pixel.
//
// One line of JSON says what the hierarchies and the rays took, each as CPU and wall-clock seconds. Built against the headers of
// Embree 3; with -DEMBREE4 its functions are called as those of Embree 4, whose hits are four bytes longer a ray.

#include <embree3/rtcore.h>
#include <sys/resource.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <limits>
#include <string>
#include <thread>
#include <vector>

namespace {

[[noreturn]] void fail(const std::string& what) {
    std::fprintf(stderr, "%s\n", what.c_str());
    std::exit(1);
}

// --- Vectors -------------------------------------------------------------------------------------------------------------------

struct Vec {
    float x, y, z;
};
Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vec operator*(float s, Vec a) { return {s * a.x, s * a.y, s * a.z}; }
Vec operator*(Vec a, Vec b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
float dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
Vec unit(Vec a) {
    const float n = dot(a, a);
    return n > 0 ? (1 / std::sqrt(n)) * a : a;
}

// --- Sample points: the same as src/render/reference/sampling.rs ---------------------------------------------------------------

uint32_t hash(uint32_t x) {
    x += 0x9e3779b9u;
    x = (x ^ (x >> 16)) * 0x21f0aaadu;
    x = (x ^ (x >> 15)) * 0x735a2d97u;
    return x ^ (x >> 15);
}
uint32_t reversed(uint32_t x) {
    x = __builtin_bswap32(x);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
    x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
    return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}
uint32_t scramble(uint32_t x, uint32_t seed) {
    x = reversed(x) + seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return reversed(x);
}
uint32_t second(uint32_t index) {
    uint32_t y = 0;
    for (uint32_t column = 1u << 31; index != 0; index >>= 1, column ^= column >> 1)
        if (index & 1) y ^= column;
    return y;
}
/// Where sample `index` of pixel (x, y) is in it, in pixels.
void place(uint32_t x, uint32_t y, uint32_t index, double at[2]) {
    const uint32_t set = hash(x ^ hash(y ^ hash(index & 1)));
    const uint32_t i = scramble(index >> 1, hash(set));
    at[0] = scramble(reversed(i), hash(set ^ 0x5bd1e995u)) / 4294967296.0;
    at[1] = scramble(second(i), hash(set ^ 0xa136aaadu)) / 4294967296.0;
}

// --- The landscape -------------------------------------------------------------------------------------------------------------

struct Mesh {
    std::vector<Vec> positions, normals, colours;  // Normals may be none.
    std::vector<uint32_t> indices;
};
struct Copy {
    uint32_t mesh;
    float matrix[12];  // Mesh to world, row by row.
};
struct Landscape {
    std::vector<Mesh> meshes;
    std::vector<Copy> copies;
    Vec sun, irradiance, sky, background;
    double eye[3], target[3], yfov;
};

struct Input {
    std::ifstream file;
    template <class T>
    void read(T* to, size_t n) {
        file.read(reinterpret_cast<char*>(to), static_cast<std::streamsize>(n * sizeof(T)));
        if (!file) fail("the landscape ends too early");
    }
    template <class T>
    T one() {
        T value;
        read(&value, 1);
        return value;
    }
    template <class T>
    std::vector<T> many(size_t n) {
        std::vector<T> list(n);
        read(list.data(), n);
        return list;
    }
};

Landscape load(const std::string& path) {
    Input in{std::ifstream(path, std::ios::binary)};
    if (!in.file) fail(path + ": cannot be read");
    char magic[8];
    in.read(magic, 8);
    if (std::memcmp(magic, "VTEXTRI1", 8) != 0) fail(path + ": no landscape of triangles");
    Landscape land;
    land.meshes.resize(in.one<uint32_t>());
    for (Mesh& mesh : land.meshes) {
        const uint32_t vertices = in.one<uint32_t>(), normals = in.one<uint32_t>(), triangles = in.one<uint32_t>();
        mesh.positions = in.many<Vec>(vertices);
        mesh.normals = in.many<Vec>(normals);
        mesh.colours = in.many<Vec>(vertices);
        mesh.indices = in.many<uint32_t>(3 * size_t(triangles));
    }
    land.copies = in.many<Copy>(in.one<uint32_t>());
    for (Vec* v : {&land.sun, &land.irradiance, &land.sky, &land.background}) in.read(v, 1);
    in.read(land.eye, 3);
    in.read(land.target, 3);
    land.yfov = in.one<double>();
    return land;
}

// --- Embree --------------------------------------------------------------------------------------------------------------------

#ifdef EMBREE4
struct Arguments {
    int flags = 0;
    unsigned features = ~0u;
    void* rest[6] = {};
};
extern "C" {
void intersect1(RTCScene, void*, Arguments*) __asm__("rtcIntersect1");
void intersect8(const int*, RTCScene, void*, Arguments*) __asm__("rtcIntersect8");
void intersect16(const int*, RTCScene, void*, Arguments*) __asm__("rtcIntersect16");
void occluded1(RTCScene, void*, Arguments*) __asm__("rtcOccluded1");
void occluded8(const int*, RTCScene, void*, Arguments*) __asm__("rtcOccluded8");
void occluded16(const int*, RTCScene, void*, Arguments*) __asm__("rtcOccluded16");
}
struct Query {
    Arguments arguments;
    explicit Query(bool coherent) { arguments.flags = coherent; }
};
#else
struct Query {
    RTCIntersectContext context;
    explicit Query(bool coherent) {
        rtcInitIntersectContext(&context);
        context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    }
};
#endif

/// N rays and what they hit, as Embree has them.
template <int N>
struct alignas(64) Packet {
    float org[3][N], tnear[N], dir[3][N], time[N], tfar[N];
    unsigned mask[N], id[N], flags[N];
    float normal[3][N], u[N], v[N];
    unsigned prim[N], geom[N], inst[N], beyond[N];
};

template <int N>
void intersect(RTCScene scene, Query& query, const int* valid, Packet<N>& p) {
#ifdef EMBREE4
    if constexpr (N == 1) intersect1(scene, &p, &query.arguments);
    if constexpr (N == 8) intersect8(valid, scene, &p, &query.arguments);
    if constexpr (N == 16) intersect16(valid, scene, &p, &query.arguments);
#else
    if constexpr (N == 1) rtcIntersect1(scene, &query.context, reinterpret_cast<RTCRayHit*>(&p));
    if constexpr (N == 8) rtcIntersect8(valid, scene, &query.context, reinterpret_cast<RTCRayHit8*>(&p));
    if constexpr (N == 16) rtcIntersect16(valid, scene, &query.context, reinterpret_cast<RTCRayHit16*>(&p));
#endif
}
template <int N>
void occluded(RTCScene scene, Query& query, const int* valid, Packet<N>& p) {
#ifdef EMBREE4
    if constexpr (N == 1) occluded1(scene, &p, &query.arguments);
    if constexpr (N == 8) occluded8(valid, scene, &p, &query.arguments);
    if constexpr (N == 16) occluded16(valid, scene, &p, &query.arguments);
#else
    if constexpr (N == 1) rtcOccluded1(scene, &query.context, reinterpret_cast<RTCRay*>(&p));
    if constexpr (N == 8) rtcOccluded8(valid, scene, &query.context, reinterpret_cast<RTCRay8*>(&p));
    if constexpr (N == 16) rtcOccluded16(valid, scene, &query.context, reinterpret_cast<RTCRay16*>(&p));
#endif
}

RTCGeometry triangles(RTCDevice device, const Mesh& mesh, RTCBuildQuality quality) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // In memory of Embree's own, which reads beyond the last of them.
    void* to = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec), mesh.positions.size());
    std::memcpy(to, mesh.positions.data(), mesh.positions.size() * sizeof(Vec));
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.indices.data(), 0, 12, mesh.indices.size() / 3);
    rtcSetGeometryBuildQuality(geometry, quality);
    rtcCommitGeometry(geometry);
    return geometry;
}

bool is_identity(const float m[12]) {
    for (int k = 0; k < 12; k++)
        if (m[k] != (k % 5 == 0 ? 1.0f : 0.0f)) return false;
    return true;
}

/// Two levels: a mesh once, copies of it as instances; what stands once, and where it is, in the upper one. Geometry i of the
/// upper one is copy i.
RTCScene build(RTCDevice device, const Landscape& land) {
    std::vector<RTCScene> parts(land.meshes.size(), nullptr);
    RTCScene all = rtcNewScene(device);
    for (const Copy& copy : land.copies) {
        const Mesh& mesh = land.meshes[copy.mesh];
        RTCGeometry geometry;
        if (is_identity(copy.matrix)) {
            geometry = triangles(device, mesh, RTC_BUILD_QUALITY_MEDIUM);
        } else {
            RTCScene& part = parts[copy.mesh];
            if (!part) {
                part = rtcNewScene(device);
                // With splits of large triangles: built once and traced often.
                rtcSetSceneBuildQuality(part, RTC_BUILD_QUALITY_HIGH);
                RTCGeometry own = triangles(device, mesh, RTC_BUILD_QUALITY_HIGH);
                rtcAttachGeometry(part, own);
                rtcReleaseGeometry(own);
                rtcCommitScene(part);
            }
            geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
            rtcSetGeometryInstancedScene(geometry, part);
            rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, copy.matrix);
            rtcCommitGeometry(geometry);
        }
        rtcAttachGeometryByID(all, geometry, static_cast<unsigned>(&copy - land.copies.data()));
        rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(all);
    return all;
}

// --- Light ---------------------------------------------------------------------------------------------------------------------

/// What a ray sees but for the sun, and the ray towards the sun that decides on it.
struct Seen {
    Vec light, sunlight, lifted;
    bool faces_sun;
};

Vec at(const float m[12], Vec p, float one) {
    return {m[0] * p.x + m[1] * p.y + m[2] * p.z + one * m[3], m[4] * p.x + m[5] * p.y + m[6] * p.z + one * m[7],
            m[8] * p.x + m[9] * p.y + m[10] * p.z + one * m[11]};
}
/// A normal by the matrix of cofactors.
Vec turned(const float m[12], Vec n) {
    const Vec a{m[0], m[1], m[2]}, b{m[4], m[5], m[6]}, c{m[8], m[9], m[10]};
    const Vec u = cross(b, c), v = cross(c, a), w = cross(a, b);
    const float sign = dot(a, u) < 0 ? -1.0f : 1.0f;
    return {sign * dot(u, n), sign * dot(v, n), sign * dot(w, n)};
}

Seen shade(const Landscape& land, const Copy& copy, unsigned triangle, float u, float v, Vec dir) {
    const Mesh& mesh = land.meshes[copy.mesh];
    const uint32_t* i = &mesh.indices[3 * size_t(triangle)];
    const Vec p[3] = {mesh.positions[i[0]], mesh.positions[i[1]], mesh.positions[i[2]]};
    const float w[3] = {1 - u - v, u, v};
    const Vec point = w[0] * p[0] + w[1] * p[1] + w[2] * p[2];
    const Vec albedo = w[0] * mesh.colours[i[0]] + w[1] * mesh.colours[i[1]] + w[2] * mesh.colours[i[2]];
    Vec normal = unit(cross(p[1] - p[0], p[2] - p[0])), lifted = point;
    if (!mesh.normals.empty()) {
        const Vec n[3] = {mesh.normals[i[0]], mesh.normals[i[1]], mesh.normals[i[2]]};
        normal = unit(w[0] * n[0] + w[1] * n[1] + w[2] * n[2]);
        const float side = dot(turned(copy.matrix, normal), dir) > 0 ? -1.0f : 1.0f;
        lifted = {0, 0, 0};
        for (int k = 0; k < 3; k++) {
            const Vec towards = side * n[k];
            lifted = lifted + w[k] * (point - std::fmin(dot(point - p[k], towards), 0.0f) * towards);
        }
    }
    normal = unit(turned(copy.matrix, normal));
    if (dot(normal, dir) > 0) normal = -1.0f * normal;
    const float cosine = dot(normal, land.sun);
    const float share = cosine * float(1 / M_PI);
    return {albedo * land.sky, share * (albedo * land.irradiance), at(copy.matrix, lifted, 1), cosine > 0};
}

// --- The picture ---------------------------------------------------------------------------------------------------------------

struct Choice {
    uint32_t width = 1280, height = 720, samples = 16, first = 0, threads = 1, packet = 8;
    bool coherent = false;
};

struct Camera {
    Vec eye, forward, right, up;
    Camera(const Landscape& land, const Choice& choice) {
        double f[3], n = 0;
        for (int k = 0; k < 3; k++) f[k] = land.target[k] - land.eye[k];
        for (double v : f) n += v * v;
        eye = {float(land.eye[0]), float(land.eye[1]), float(land.eye[2])};
        forward = {float(f[0] / std::sqrt(n)), float(f[1] / std::sqrt(n)), float(f[2] / std::sqrt(n))};
        const float half = float(std::tan(0.5 * land.yfov));
        right = unit(cross(forward, {0, 1, 0}));
        up = half * cross(right, forward);
        right = half * right;
        size[0] = choice.width, size[1] = choice.height;
    }
    Vec dir(double x, double y) const {
        const float a = float((2 * x - size[0]) / size[1]), b = float(1 - 2 * y / size[1]);
        return unit(forward + a * right + b * up);
    }
    double size[2];
};

constexpr uint32_t TILE = 16;
/// A shadow ray begins so far from its triangle: a share of the distance to the eye, which is what 32-bit numbers leave open.
constexpr float APART = 2e-6f;

struct Pixel {
    uint32_t x, y;
};

/// All samples of a tile: camera rays in packets of N neighbours, then those shadow rays that are needed, in full packets too.
template <int N>
void tile(RTCScene scene, const Landscape& land, const Camera& camera, const Choice& choice, const std::vector<Pixel>& pixels,
          float* film) {
    Query query(choice.coherent);
    struct Shadow {
        Vec from, light;
        uint32_t pixel;
        float apart;
    };
    static thread_local std::vector<Shadow> shadows;
    shadows.clear();
    const uint32_t count = uint32_t(pixels.size()) * choice.samples;
    Packet<N> p;
    alignas(64) int valid[N];
    auto add = [&](uint32_t pixel, Vec light, float cover) {
        float* to = film + 4 * (size_t(pixels[pixel].y) * choice.width + pixels[pixel].x);
        to[0] += light.x, to[1] += light.y, to[2] += light.z, to[3] += cover;
    };
    for (uint32_t first = 0; first < count; first += N) {
        for (uint32_t k = 0; k < N; k++) {
            const uint32_t number = std::min(first + k, count - 1);
            const Pixel pixel = pixels[number / choice.samples];
            double in[2];
            place(pixel.x, pixel.y, choice.first + number % choice.samples, in);
            const Vec dir = camera.dir(pixel.x + in[0], pixel.y + in[1]);
            p.org[0][k] = camera.eye.x, p.org[1][k] = camera.eye.y, p.org[2][k] = camera.eye.z;
            p.dir[0][k] = dir.x, p.dir[1][k] = dir.y, p.dir[2][k] = dir.z;
            p.tnear[k] = p.time[k] = 0, p.tfar[k] = std::numeric_limits<float>::infinity();
            p.mask[k] = ~0u, p.id[k] = p.flags[k] = 0;
            p.geom[k] = p.inst[k] = RTC_INVALID_GEOMETRY_ID;
            valid[k] = first + k < count ? -1 : 0;
        }
        intersect<N>(scene, query, valid, p);
        for (uint32_t k = 0; k < N && first + k < count; k++) {
            const uint32_t pixel = (first + k) / choice.samples;
            if (p.geom[k] == RTC_INVALID_GEOMETRY_ID) {
                add(pixel, land.background, 0);
                continue;
            }
            const Copy& copy = land.copies[p.inst[k] == RTC_INVALID_GEOMETRY_ID ? p.geom[k] : p.inst[k]];
            const Seen seen = shade(land, copy, p.prim[k], p.u[k], p.v[k], {p.dir[0][k], p.dir[1][k], p.dir[2][k]});
            add(pixel, seen.light, 1);
            if (seen.faces_sun) shadows.push_back({seen.lifted, seen.sunlight, pixel, APART * (1 + p.tfar[k])});
        }
    }
    for (size_t first = 0; first < shadows.size(); first += N) {
        for (uint32_t k = 0; k < N; k++) {
            const Shadow& shadow = shadows[std::min(first + k, shadows.size() - 1)];
            p.org[0][k] = shadow.from.x, p.org[1][k] = shadow.from.y, p.org[2][k] = shadow.from.z;
            p.dir[0][k] = land.sun.x, p.dir[1][k] = land.sun.y, p.dir[2][k] = land.sun.z;
            p.tnear[k] = shadow.apart, p.time[k] = 0, p.tfar[k] = std::numeric_limits<float>::infinity();
            p.mask[k] = ~0u, p.id[k] = p.flags[k] = 0;
            valid[k] = first + k < shadows.size() ? -1 : 0;
        }
        occluded<N>(scene, query, valid, p);
        for (uint32_t k = 0; k < N && first + k < shadows.size(); k++)
            if (p.tfar[k] >= 0) add(shadows[first + k].pixel, shadows[first + k].light, 0);
    }
}

void picture(RTCScene scene, const Landscape& land, const Choice& choice, std::vector<float>& film) {
    const Camera camera(land, choice);
    const uint32_t across = (choice.width + TILE - 1) / TILE, down = (choice.height + TILE - 1) / TILE;
    std::atomic<uint32_t> next{0};
    auto work = [&] {
        std::vector<Pixel> pixels;
        for (uint32_t t; (t = next++) < across * down;) {
            pixels.clear();
            // In Morton order, so that the rays of a packet are neighbours.
            for (uint32_t m = 0; m < TILE * TILE; m++) {
                uint32_t x = 0, y = 0;
                for (uint32_t bit = 0; bit < 4; bit++) x |= (m >> (2 * bit) & 1) << bit, y |= (m >> (2 * bit + 1) & 1) << bit;
                x += TILE * (t % across), y += TILE * (t / across);
                if (x < choice.width && y < choice.height) pixels.push_back({x, y});
            }
            if (choice.packet == 1) tile<1>(scene, land, camera, choice, pixels, film.data());
            if (choice.packet == 8) tile<8>(scene, land, camera, choice, pixels, film.data());
            if (choice.packet == 16) tile<16>(scene, land, camera, choice, pixels, film.data());
        }
    };
    std::vector<std::thread> others;
    for (uint32_t k = 1; k < choice.threads; k++) others.emplace_back(work);
    work();
    for (std::thread& other : others) other.join();
    for (float& v : film) v /= float(choice.samples);
}

// --- OpenEXR: one uncompressed part of RGBA ------------------------------------------------------------------------------------

void save(const std::string& path, const Choice& choice, const std::vector<float>& film) {
    std::string out;
    auto word = [&](uint32_t v) { out.append(reinterpret_cast<const char*>(&v), 4); };
    auto real = [&](float v) { out.append(reinterpret_cast<const char*>(&v), 4); };
    auto attribute = [&](const char* name, const char* type, uint32_t bytes) {
        out.append(name, std::strlen(name) + 1);
        out.append(type, std::strlen(type) + 1);
        word(bytes);
    };
    word(20000630), word(2);
    attribute("channels", "chlist", 4 * 18 + 1);
    for (const char* channel : {"A", "B", "G", "R"}) {
        out.append(channel, 2);
        word(2), word(0), word(1), word(1);
    }
    out.push_back(0);
    attribute("compression", "compression", 1);
    out.push_back(0);
    for (const char* window : {"dataWindow", "displayWindow"}) {
        attribute(window, "box2i", 16);
        word(0), word(0), word(choice.width - 1), word(choice.height - 1);
    }
    attribute("lineOrder", "lineOrder", 1);
    out.push_back(0);
    attribute("pixelAspectRatio", "float", 4), real(1);
    attribute("screenWindowCenter", "v2f", 8), real(0), real(0);
    attribute("screenWindowWidth", "float", 4), real(1);
    out.push_back(0);
    const uint64_t row = 8 + 16 * uint64_t(choice.width), start = out.size() + 8 * uint64_t(choice.height);
    for (uint64_t y = 0; y < choice.height; y++) {
        const uint64_t offset = start + y * row;
        out.append(reinterpret_cast<const char*>(&offset), 8);
    }
    for (uint32_t y = 0; y < choice.height; y++) {
        word(y), word(16 * choice.width);
        for (int channel : {3, 2, 1, 0})
            for (uint32_t x = 0; x < choice.width; x++) real(film[4 * (size_t(y) * choice.width + x) + channel]);
    }
    std::ofstream file(path, std::ios::binary);
    file << out;
    if (!file.flush()) fail(path + ": cannot be written");
}

struct Clock {
    double cpu, wall;
    static Clock now() {
        timespec t;
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
        const auto wall = std::chrono::steady_clock::now().time_since_epoch();
        return {double(t.tv_sec) + 1e-9 * double(t.tv_nsec), std::chrono::duration<double>(wall).count()};
    }
};

}  // namespace

int main(int argc, char** argv) {
    Choice choice;
    std::string input, output;
    for (int k = 1; k < argc; k++) {
        const std::string word = argv[k];
        auto value = [&] { return k + 1 < argc ? std::string(argv[++k]) : (fail(word + " needs a value"), std::string()); };
        auto number = [&] { return uint32_t(std::strtoul(value().c_str(), nullptr, 10)); };
        if (word == "--size") {
            if (std::sscanf(value().c_str(), "%ux%u", &choice.width, &choice.height) != 2) fail("--size is WIDTHxHEIGHT");
        } else if (word == "--samples") choice.samples = number();
        else if (word == "--first") choice.first = number();
        else if (word == "--threads") choice.threads = number();
        else if (word == "--packet") choice.packet = number();
        else if (word == "--coherent") choice.coherent = true;
        else if (word == "-o") output = value();
        else input = word;
    }
    if (input.empty() || output.empty() || !choice.samples || !choice.threads || !choice.width || !choice.height ||
        (choice.packet != 1 && choice.packet != 8 && choice.packet != 16))
        fail("usage: embree LANDSCAPE -o OUT.exr [--size WxH] [--samples N] [--first N] [--threads N] [--packet 1|8|16] [--coherent]");
    const Landscape land = load(input);
    RTCDevice device = rtcNewDevice(("threads=" + std::to_string(choice.threads)).c_str());
    if (!device) fail("Embree does not start");
    const Clock start = Clock::now();
    RTCScene scene = build(device, land);
    const Clock built = Clock::now();
    std::vector<float> film(4 * size_t(choice.width) * choice.height, 0.0f);
    picture(scene, land, choice, film);
    const Clock traced = Clock::now();
    if (const RTCError error = rtcGetDeviceError(device)) fail("Embree: error " + std::to_string(error));
    save(output, choice, film);
    rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    const long version = rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION);
    std::printf("{\"version\": %ld, \"build_cpu_seconds\": %.4f, \"build_seconds\": %.4f, \"trace_cpu_seconds\": %.4f, "
                "\"trace_seconds\": %.4f, \"peak_bytes\": %ld}\n",
                version, built.cpu - start.cpu, built.wall - start.wall, traced.cpu - built.cpu, traced.wall - built.wall,
                usage.ru_maxrss * 1024L);
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
}
