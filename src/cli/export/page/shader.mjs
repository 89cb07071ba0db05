// The march and the shading of section 10 of the format, for WebGL2.
//
// Based on: J. Amanatides, A. Woo, A Fast Voxel Traversal Algorithm, EG 1987; E. Heitz et al., The SGGX Microflake Distribution,
// SIGGRAPH 2015 (visible normals), at the eight fixed points of our renderer.

export const VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

export const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler3D;
uniform usampler3D index_;
uniform usampler3D atlas;
uniform usampler3D kinds;
uniform int cells, across, side, channel, samples;
uniform bool isotropic, mixed;
uniform vec2 size, shift;
uniform float exposure;
uniform vec3 eye, right, up, ahead, sun, low, high;
uniform vec3 palette[64];
out vec4 colour;

const float PI = 3.14159265;
// The shadow ray starts this many voxels from what it lights.
const float START = 1.0;
const vec2 POINTS[8] = vec2[8](vec2(0.459701, 0.0), vec2(0.0, 0.459701), vec2(-0.459701, 0.0), vec2(0.0, -0.459701),
  vec2(0.627963, 0.627963), vec2(-0.627963, 0.627963), vec2(-0.627963, -0.627963), vec2(0.627963, -0.627963));

struct Matter { float rate, c, share; vec3 low, high, albedo, mean; mat3 s; int kind; };

ivec3 place(uint brick, ivec3 v) {
  int b = int(brick) - 1;
  return ivec3(b % across, (b / across) % across, b / (across * across)) * 8 + (v & 7);
}

Matter matter(uint brick, ivec3 v) {
  ivec3 at = place(brick, v);
  uvec4 w = texelFetch(atlas, at, 0);
  Matter m;
  uint code = w.x & 255u;
  m.rate = code == 0u ? 0.0 : exp2((float(code) - 144.0) / 16.0);
  m.c = float(w.x >> 8 & 15u) / 15.0;
  m.share = float(w.x >> 12 & 15u) / 15.0;
  vec2 o = vec2(w.x >> 16 & 255u, w.x >> 24) / 127.5 - 1.0;
  m.mean = vec3(o, 1.0 - abs(o.x) - abs(o.y));
  if (m.mean.z < 0.0) m.mean.xy -= vec2(m.mean.x < 0.0 ? 1.0 : -1.0, m.mean.y < 0.0 ? 1.0 : -1.0) * m.mean.z;
  m.mean = normalize(m.mean);
  vec3 r = vec3(w.y & 255u, w.y >> 8 & 255u, w.y >> 16 & 255u) / 255.0;
  vec3 k = (vec3(w.y >> 24, w.z & 255u, w.z >> 8 & 255u) - 128.0) / 127.0;
  // A little smaller than the largest factor that keeps the matrix positive.
  for (int i = 0; i < 12; i++) if (1.0 + 2.0 * k.x * k.y * k.z - dot(k, k) < 0.0) k *= 0.93;
  m.s = mat3(r.x * r.x, k.x * r.x * r.y, k.y * r.x * r.z, k.x * r.x * r.y, r.y * r.y, k.z * r.y * r.z, k.y * r.x * r.z, k.z * r.y * r.z, r.z * r.z);
  uvec3 box = uvec3(w.z >> 16 & 255u, w.z >> 24, w.w & 255u);
  m.low = vec3(box & 15u) / 16.0;
  m.high = 1.0 - vec3(box >> 4) / 16.0;
  vec3 a = vec3(w.w >> 8 & 255u, w.w >> 16 & 255u, w.w >> 24) / 255.0;
  m.albedo = a * a;
  m.kind = mixed ? int(texelFetch(kinds, at, 0).x) : 0;
  return m;
}

// Mean of max(0, n·l) over the visible normals n, and their mean direction.
float lit(Matter m, vec3 view, vec3 light, out vec3 normal) {
  vec3 t = normalize(abs(view.z) < 0.9 ? cross(view, vec3(0, 0, 1)) : cross(view, vec3(1, 0, 0)));
  mat3 frame = mat3(t, cross(view, t), view);
  mat3 s = transpose(frame) * m.s * frame;
  // Columns of U, where U Uᵀ is s, the last along the view.
  float zz = sqrt(max(s[2][2], 1e-6));
  vec3 w = vec3(s[2][0], s[2][1], s[2][2]) / zz;
  float yy = sqrt(max(s[1][1] - w.y * w.y, 1e-6)), xy = (s[1][0] - w.x * w.y) / yy;
  vec3 v = vec3(xy, yy, 0.0), u = vec3(sqrt(max(s[0][0] - w.x * w.x - xy * xy, 1e-6)), 0.0, 0.0);
  float squares = 0.0;
  vec3 n[8];
  for (int i = 0; i < 8; i++) {
    vec2 p = POINTS[i];
    n[i] = frame * normalize(p.x * u + p.y * v + sqrt(1.0 - dot(p, p)) * w);
    squares += pow(dot(n[i], m.mean), 2.0) / 8.0;
  }
  float k = m.share / max(squares, 0.05), sum = 0.0, total = 0.0;
  normal = vec3(0);
  for (int i = 0; i < 8; i++) {
    float weight = max(0.0, 1.0 + k * dot(n[i], m.mean));
    total += weight;
    sum += weight * max(0.0, dot(n[i], light));
    normal += weight * n[i];
  }
  normal = normal / max(total, 1e-3);
  return sum / max(total, 1e-3);
}

vec2 slab(vec3 o, vec3 inverse, vec3 a, vec3 b) {
  vec3 s = (a - o) * inverse, e = (b - o) * inverse, near = min(s, e), far = max(s, e);
  return vec2(max(near.x, max(near.y, near.z)), min(far.x, min(far.y, far.z)));
}

struct March { float t; vec3 albedo, direct, normal, kind, position; float weight; };

// Along a ray in voxels from where it starts; with \`shade\` what is seen, else the transmittance alone.
March march(vec3 o, vec3 d, bool shade) {
  March r = March(1.0, vec3(0), vec3(0), vec3(0), vec3(0), vec3(0), 0.0);
  vec3 inverse = 1.0 / (d + vec3(equal(d, vec3(0))) * 1e-9);
  vec2 span = slab(o, inverse, low * float(side), high * float(side));
  // From where the ray enters: far from there, steps as small as these would be lost in 32 bits.
  o += max(span.x, 0.0) * d;
  span = vec2(0.0, span.y - max(span.x, 0.0));
  float nudge = 1e-4 * max(1.0, float(side) / 256.0), t = nudge, block = 1.0;
  ivec3 current = ivec3(-1);
  for (int i = 0; i < 2048 && t < span.y; i++) {
    // On the cube's faces a place may be rounded to just outside of it.
    ivec3 v = clamp(ivec3(floor(o + t * d)), ivec3(0), ivec3(side - 1));
    uint brick = texelFetch(index_, v >> 3, 0).x;
    float edge = brick == 0u ? float(min(8, side)) : 1.0;
    vec3 corner = floor(vec3(v) / edge) * edge;
    float leave = slab(o, inverse, corner, corner + edge).y;
    if (brick != 0u) {
      Matter m = matter(brick, v);
      if (any(notEqual(v >> 2, current))) {
        r.t *= block;
        block = 1.0;
        current = v >> 2;
      }
      vec2 piece = slab(o, inverse, vec3(v) + m.low, vec3(v) + m.high);
      float length_ = min(piece.y, min(leave, span.y)) - max(piece.x, t - nudge);
      if (m.rate > 0.0 && length_ > 0.0) {
        float tau = m.rate * length_ * (isotropic ? 1.0 : sqrt(max(0.0, dot(d, m.s * d))));
        float k = (1.0 - m.c) * tau, phi = k < 1e-3 ? 1.0 - 0.5 * k : (1.0 - exp(-k)) / k;
        float after = max(0.0, block * exp(-k) - m.c * tau * phi), weight = r.t * (block - after);
        block = after;
        if (shade && weight > 0.002) {
          vec3 normal;
          float cosine = lit(m, -d, sun, normal);
          r.albedo += weight * m.albedo;
          r.direct += weight * m.albedo * cosine;
          r.normal += weight * normal;
          r.kind += weight * palette[m.kind & 63];
          r.position += weight * (o + 0.5 * (max(piece.x, t) + leave) * d);
          r.weight += weight;
        }
        if (r.t * block < 0.004) {
          block = 0.0;
          break;
        }
      }
    }
    t = max(leave, t) + nudge;
  }
  r.t *= block;
  return r;
}

vec3 seen(vec2 pixel) {
  vec2 p = (2.0 * pixel - size) / size.y - shift;
  vec3 d = normalize(ahead + p.x * right + p.y * up), o = eye * float(side);
  vec3 background = mix(vec3(0.62, 0.68, 0.74), vec3(0.86, 0.89, 0.92), clamp(0.5 + d.z, 0.0, 1.0));
  background *= background;
  March r = march(o, d, true);
  float covered = max(r.weight, 1e-4);
  if (channel == 3) return vec3(1.0 - r.t);
  if (channel == 1) return mix(background, r.albedo / covered, 1.0 - r.t);
  if (channel == 2) return mix(background, 0.5 + 0.5 * r.normal / covered, 1.0 - r.t);
  if (channel == 4) return mix(background, r.kind / covered, 1.0 - r.t);
  float visible = 1.0;
  if (r.weight > 0.01) visible = march(r.position / r.weight + START * sun, sun, false).t;
  vec3 sky = vec3(0.42, 0.5, 0.62), lamp = vec3(3.0, 2.85, 2.6) / PI;
  float scale = (1.0 - r.t) / covered;
  return exposure * scale * (r.albedo * sky + r.direct * lamp * 3.0 * visible) + r.t * background;
}

void main() {
  vec3 sum = vec3(0);
  for (int i = 0; i < samples; i++) sum += seen(gl_FragCoord.xy + (samples == 1 ? vec2(0) : vec2(float(i & 1), float(i >> 1)) * 0.5 - 0.25));
  vec3 c = sum / float(samples);
  if (channel == 0 || channel == 1 || channel == 4) c = mix(12.92 * c, 1.055 * pow(max(c, 1e-5), vec3(1.0 / 2.4)) - 0.055, vec3(greaterThan(c, vec3(0.0031308))));
  colour = vec4(c, 1);
}`;
