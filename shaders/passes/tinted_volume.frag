// The tinted picture in one pass: density interpolated, label nearest, tint multiplied on.
//
//   a = 1 - (1 - opacity(density) tint.a)^(length / min(spacing))        opacity correction
//   C += (1 - A) a min(color(density) tint.rgb light + highlight, 1),  A += (1 - A) a
//   (Li et al. 2012, section 4.1; front to back, until A reaches OPAQUE)
//
// in:  lib/ray.glsl, lib/density.glsl, ...; lengths in voxels (x y z) and mm as said there
//      u_tints        straight RGBA by ID (lib/label_lookup.glsl);  u_tint_rows its height
//      u_spacing      mm a voxel, x y z;  u_reference: min(spacing), mm
//      u_jitter       1: samples start at a hash of the pixel;  u_shaded: 0 without light
// out: [0] premultiplied RGBA   [1] t in mm where A first reached 1/2, NO_DEPTH where never
// cpu twin: raycasting/tinted.py
// test:     tests/rendering/test_parity.py

#include "lib/ray_box.glsl"
#include "lib/skip_empty.glsl"
#include "lib/label_lookup.glsl"
#include "lib/density.glsl"
#include "lib/gradient.glsl"
#include "lib/transfer_function.glsl"
#include "lib/light.glsl"
#include "lib/no_depth.glsl"

#define OPAQUE 0.99

uniform sampler2D u_tints;
uniform float u_tint_rows;
uniform vec3 u_spacing;
uniform float u_reference;
uniform float u_jitter;
uniform float u_shaded;

void main() {
    vec2 pixel = gl_FragCoord.xy - 0.5;
    vec3 origin = ray_origin(pixel);
    vec3 direction = ray_direction(pixel);
    float phase = u_jitter > 0.5 ? jittered_phase(pixel) : 0.5;
    vec2 range = sample_range(origin, direction, phase);
    float speed = length(direction * u_spacing);
    vec3 along = direction * u_spacing / speed;
    float exponent = speed * u_step / u_reference;
    vec4 sum = vec4(0.0);
    vec4 tint = vec4(0.0);
    float previous = -1.0;
    float depth = NO_DEPTH;
    float k = range.x;
    float skip_from = u_skip > 0.5 ? k : range.y;
    while (k < range.y) {
        float t = (k + phase) * u_step;
        vec3 p = origin + t * direction;
        vec3 voxel = floor(p + 0.5);
        if (k >= skip_from) {
            float away = brick_distance(voxel);
            skip_from = leap(away, voxel, k, origin, direction, phase);
            if (away > 0.0) {
                k = skip_from;
                continue;
            }
        }
        k += 1.0;
        float id = label_at(voxel);
        if (id != previous) {
            previous = id;
            tint = table_row(u_tints, u_tint_rows, id);
        }
        if (tint.a <= 0.0)
            continue;
        vec4 entry = transfer(density_at(p)) * tint;
        if (entry.a <= 0.0)
            continue;
        float a = 1.0 - pow(1.0 - min(entry.a, 1.0), exponent);
        vec2 light = vec2(u_light.x + u_light.y, 0.0);
        if (u_shaded > 0.5)
            light = light_of(gradient_at(p) * u_reference / u_spacing, along);
        float weight = (1.0 - sum.a) * a;
        float before = sum.a;
        sum += weight * vec4(min(entry.rgb * light.x + light.y, 1.0), 1.0);
        if (before < 0.5 && sum.a >= 0.5)
            depth = t;
        if (sum.a >= OPAQUE)
            break;
    }
    gl_FragData[0] = sum;
    gl_FragData[1] = vec4(depth);
}
