// The runs of visible objects along a ray, six a pass: all that any occlusion ratio is made of.
//
//   run = (ID, samples of it) until a sample of another visible object; hidden matter between two
//   stretches of one object does not part them
//   (Li et al. 2012, section 5.1: the listing's run lengths, without its atomics)
//
// in:  lib/ray.glsl, lib/label_lookup.glsl
//      u_visible      red > 1/2 where the object of this ID counts;  u_visible_rows its height
//      u_resume       k at which the pass before ran out of room;  u_first: 1 in the first pass
//      u_size         pixels: width, height
// out: [0] [1] [2] two runs each (ID, samples, ID, samples), zeros where there is none
//      [3] k to resume from, NO_MORE once the ray is done
// cpu twin: rendering/cpu/occlusion.py
// test:     tests/rendering/gl/test_occlusion_runs.py

#include "lib/ray_box.glsl"
#include "lib/skip_empty.glsl"
#include "lib/label_lookup.glsl"

#define NO_MORE 1.0e30

uniform sampler2D u_visible;
uniform float u_visible_rows;
uniform sampler2D u_resume;
uniform float u_first;
uniform vec2 u_size;

vec4 runs_a;
vec4 runs_b;
vec4 runs_c;

void put(float slot, float id, float samples) {
    vec2 run = vec2(id, samples);
    if (slot < 0.5) runs_a.xy = run;
    else if (slot < 1.5) runs_a.zw = run;
    else if (slot < 2.5) runs_b.xy = run;
    else if (slot < 3.5) runs_b.zw = run;
    else if (slot < 4.5) runs_c.xy = run;
    else runs_c.zw = run;
}

void main() {
    vec2 pixel = gl_FragCoord.xy - 0.5;
    vec3 origin = ray_origin(pixel);
    vec3 direction = ray_direction(pixel);
    vec2 range = sample_range(origin, direction, 0.5);
    runs_a = runs_b = runs_c = vec4(0.0);
    float k = range.x;
    if (u_first < 0.5)
        k = max(k, texture2D(u_resume, gl_FragCoord.xy / u_size).r);
    float skip_from = u_skip > 0.5 ? k : range.y;
    float slot = -1.0;
    float current = 0.0;
    float samples = 0.0;
    float resume = NO_MORE;
    while (k < range.y) {
        while (k < range.y && k >= skip_from) {
            vec3 voxel = floor(origin + (k + 0.5) * u_step * direction + 0.5);
            float away = brick_distance(voxel);
            skip_from = leap(away, voxel, k, origin, direction, 0.5);
            k = away > 0.0 ? skip_from : k;
        }
        if (k >= range.y)
            break;
        float id = label_at(floor(origin + (k + 0.5) * u_step * direction + 0.5));
        if (id == current) {
            samples += 1.0;
        } else if (table_row(u_visible, u_visible_rows, id).r > 0.5) {
            if (slot >= 0.0)
                put(slot, current, samples);
            if (slot > 4.5) {
                resume = k;
                samples = 0.0;
                break;
            }
            slot += 1.0;
            current = id;
            samples = 1.0;
        }
        k += 1.0;
    }
    if (slot >= 0.0 && samples > 0.0)
        put(slot, current, samples);
    gl_FragData[0] = runs_a;
    gl_FragData[1] = runs_b;
    gl_FragData[2] = runs_c;
    gl_FragData[3] = vec4(resume);
}
