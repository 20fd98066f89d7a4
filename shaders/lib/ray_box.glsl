// Which samples of the lattice have their nearest voxel inside the volume.
//
//   slabs -1/2 <= p_i < n_i - 1/2 give an interval of t, rounded to integers k and then corrected
//   by the very test the loop relies on, floor(p + 1/2) in [0, n)
//
// in:  u_shape        voxels of the whole volume, x y z
//      origin, direction of the ray (lib/ray.glsl); planes (lib/clip_planes.glsl)
// out: (first, end): half-open range of k
// cpu twin: rendering/cpu/ray_sampling.py (sample_range)
// test:     tests/rendering/gl/test_glsl_functions.py

#include "lib/ray.glsl"
#include "lib/clip_planes.glsl"

uniform vec3 u_shape;

#define FAR_SAMPLE 8.0e6

bool in_volume(vec3 origin, vec3 direction, float t) {
    vec3 voxel = floor(origin + t * direction + 0.5);
    return all(greaterThanEqual(voxel, vec3(0.0))) && all(lessThan(voxel, u_shape));
}

vec2 sample_range(vec3 origin, vec3 direction, float phase) {
    // A ray along a face of the slab needs no exact zero: any tiny slope gives a huge interval.
    vec3 slope = mix(direction, vec3(1.0e-20), vec3(lessThan(abs(direction), vec3(1.0e-20))));
    vec3 a = (-0.5 - origin) / slope;
    vec3 b = (u_shape - 0.5 - origin) / slope;
    vec3 low = min(a, b);
    vec3 high = max(a, b);
    float first = max(max(low.x, low.y), low.z);
    float last = min(min(high.x, high.y), high.z);
    if (!(first < last))
        return vec2(0.0);
    float k = max(floor(first / u_step - phase) - 1.0, -FAR_SAMPLE);
    float end = min(ceil(last / u_step - phase) + 2.0, FAR_SAMPLE);
    if ((k + phase) * u_step <= u_near)
        k = floor(u_near / u_step - phase) + 1.0;
    while (k < end && !in_volume(origin, direction, (k + phase) * u_step))
        k += 1.0;
    while (end > k && !in_volume(origin, direction, (end - 1.0 + phase) * u_step))
        end -= 1.0;
    vec2 range = clipped_range(vec2(k, end), origin, direction, phase);
    return vec2(range.x, max(range.x, range.y));
}
