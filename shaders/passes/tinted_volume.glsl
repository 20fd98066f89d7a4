// The tinted image in one pass: density interpolated, label nearest, tint multiplied on.
//
//   a = 1 - (1 - opacity(density) tint.a)^(length / min(spacing))        opacity correction
//   C += (1 - A) a min(color(density) tint.rgb light + highlight, 1),  A += (1 - A) a
//   (Li et al. 2012, section 4.1; front to back, until A reaches OPAQUE)
//
// in:  lib/ray.glsl, lib/density.glsl, ...; lengths in voxels (x y z) and mm as said there
//      u_tints        straight RGBA by ID (lib/label_lookup.glsl);  u_tint_rows its height
//      u_spacing      mm a voxel, x y z;  u_reference: min(spacing), mm
//      u_run          samples from one asking of bricks to the next; 0: as far as they are alike
//      u_jitter       1: samples start at a hash of the pixel
//      SHADED         a define, with light;  VOXELS: a define, density from lib/voxel_buffer.glsl
// out: [0] premultiplied RGBA   [1] t in mm where A first reached 1/2, NO_DEPTH where never
// cpu twin: rendering/cpu/tinted.py (tinted), rendering/cpu/compositing.py (march)
// test:     tests/rendering/gl/test_parity.py

#ifdef VOXELS
#extension GL_EXT_gpu_shader4 : require
#endif
#include "lib/pixel.glsl"
#include "lib/ray_box.glsl"
#include "lib/skip_empty.glsl"
#include "lib/label_lookup.glsl"
#ifdef VOXELS
#include "lib/voxel_buffer.glsl"
#else
#include "lib/density.glsl"
#include "lib/gradient.glsl"
#endif
#include "lib/transfer_function.glsl"
#include "lib/light.glsl"
#include "lib/no_depth.glsl"

#define OPAQUE 0.99

uniform sampler2D u_tints;
uniform float u_tint_rows;
uniform vec3 u_spacing;
uniform float u_reference;
uniform float u_jitter;
uniform float u_run;

void main() {
    if (OUTSIDE)
        return;
    vec2 pixel = PIXEL;
    vec3 origin = ray_origin(pixel);
    vec3 direction = ray_direction(pixel);
    float phase = u_jitter > 0.5 ? jittered_phase(pixel) : 0.5;
    vec2 range = sample_range(origin, direction, phase);
    float speed = length(direction * u_spacing);
    vec3 along = direction * u_spacing / speed;
    float exponent = speed * u_step / u_reference;
    float plain = abs(exponent - 1.0) < 1.0e-5 ? 1.0 : 0.0;
    vec3 to_world = u_reference / u_spacing;
    vec4 sum = vec4(0.0);
    float depth = NO_DEPTH;
    float k = range.x;
#ifdef VOXELS
    ivec3 size = ivec3(u_shape);
    ivec3 last = size - 1;
    ivec3 stride = ivec3(1, size.x, size.x * size.y);
#endif
    // Bricks are asked once a run, not before every sample, and its loops test last but for the
    // outermost: software rasterisers pass through the body of a loop that tests first once more
    // than it runs, and through both sides of every branch. Samples of a run that lie in bricks
    // beyond add nothing, as the bricks are those of all that can be seen.
    while (k < range.y) {
        float stop = range.y;
        if (u_skip > 0.5) {
            float away = 0.0;
            do {
                vec3 voxel = floor(origin + (k + phase) * u_step * direction + 0.5);
                away = brick_distance(voxel);
                float until = leap(away, voxel, k, origin, direction, phase);
                k = away > 0.0 ? until : k;
                stop = u_run > 0.0 ? k + u_run : until;
            } while (away > 0.0 && k < range.y);
        }
        float end = min(stop, range.y);
        // All pixels leave with u_run together: llvmpipe of Mesa 22 takes values out of a loop
        // that tests last from its last pass, also for pixels that had left before.
        float left = u_run > 0.0 ? u_run : end - k;
        do {
            float t = (k + phase) * u_step;
            vec3 p = origin + t * direction;
            vec4 tint = table_row(u_tints, u_tint_rows, label_at(floor(p + 0.5)));
#ifdef VOXELS
            vec4 around = gradient_and_density_at(p, last, stride);
            float density = around.w;
#else
            float density = density_at(p);
#endif
            vec4 entry = transfer(density) * tint;
            if (k < end && entry.a > 0.0) {
                float a = min(entry.a, 1.0);
                if (plain < 0.5)
                    a = 1.0 - pow(1.0 - a, exponent);
#ifdef SHADED
#ifdef VOXELS
                vec3 gradient = around.xyz;
#else
                vec3 gradient = gradient_at(p);
#endif
                vec2 light = light_of(gradient * to_world, along);
#else
                vec2 light = vec2(u_light.x + u_light.y, 0.0);
#endif
                float weight = (1.0 - sum.a) * a;
                float before = sum.a;
                sum += weight * vec4(min(entry.rgb * light.x + light.y, 1.0), 1.0);
                if (before < 0.5 && sum.a >= 0.5)
                    depth = t;
            }
            k = sum.a >= OPAQUE ? range.y : k + 1.0;
            left -= 1.0;
        } while (left > 0.0);
    }
    WRITE_0(sum);
    WRITE_1(vec4(depth));
}
