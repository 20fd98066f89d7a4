// One object's rays, for an occlusion query to count: a fragment lives where the object is met.
//
//   find1stOccluded (Li et al. 2012, section 5.1): discard where the ray's first object is the
//   queried one; live at the first sample of the queried one, and look no further
//
// in:  lib/ray.glsl, lib/label_lookup.glsl
//      u_queried      ID;  u_low, u_high its box, voxels, half-open, x y z
//      u_first        nearest object of every pixel, red;  u_size pixels: width, height
//      u_occluded     1: count occluded rays only; 0: all rays that meet the object
// out: anything; samples passed is the count
// cpu twin: rendering/cpu/occlusion.py (occlusion_counts)
// test:     tests/rendering/gl/test_occlusion_queries.py

#include "lib/ray_box.glsl"
#include "lib/label_lookup.glsl"

uniform float u_queried;
uniform vec3 u_low;
uniform vec3 u_high;
uniform sampler2D u_first;
uniform vec2 u_size;
uniform float u_occluded;

// Samples that may lie in the box: the lattice of the whole volume, never one of the box's own.
vec2 box_range(vec3 origin, vec3 direction) {
    vec3 slope = mix(direction, vec3(1.0e-20), vec3(lessThan(abs(direction), vec3(1.0e-20))));
    vec3 a = (u_low - 0.5 - origin) / slope;
    vec3 b = (u_high - 0.5 - origin) / slope;
    vec3 low = min(a, b);
    vec3 high = max(a, b);
    float first = max(max(low.x, low.y), low.z);
    float last = min(min(high.x, high.y), high.z);
    vec2 range = sample_range(origin, direction, 0.5);
    return vec2(max(range.x, floor(first / u_step - 0.5) - 1.0),
                min(range.y, ceil(last / u_step - 0.5) + 2.0));
}

void main() {
    float first = floor(texture2D(u_first, gl_FragCoord.xy / u_size).r + 0.5);
    // Nothing met at all, or met first: no need to walk.
    if (first < 0.5 || (u_occluded > 0.5 && first == u_queried))
        discard;
    vec2 pixel = gl_FragCoord.xy - 0.5;
    vec3 origin = ray_origin(pixel);
    vec3 direction = ray_direction(pixel);
    vec2 range = box_range(origin, direction);
    float k = range.x;
    bool met = first == u_queried;
    while (k < range.y && !met) {
        met = label_at(floor(origin + (k + 0.5) * u_step * direction + 0.5)) == u_queried;
        k += 1.0;
    }
    if (!met)
        discard;
    gl_FragData[0] = vec4(1.0);
}
