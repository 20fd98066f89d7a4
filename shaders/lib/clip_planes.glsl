// Clipping planes of the napari layer cut a ray's range of samples.
//
//   kept: dot(p(t) - point, normal) >= 0, linear in t
//
// in:  u_planes       (normal, -dot(point, normal)), voxels, x y z;  u_plane_count
// out: the range of k, narrowed
// cpu twin: rendering/cpu/ray_sampling.py (sample_range, clipping_planes)
// test:     tests/rendering/gl/test_parity.py

#include "lib/ray.glsl"

#define MAX_PLANES 8

uniform vec4 u_planes[8];
uniform float u_plane_count;

vec2 clipped_range(vec2 range, vec3 origin, vec3 direction, float phase) {
    for (int i = 0; i < MAX_PLANES; i++) {
        if (float(i) >= u_plane_count)
            break;
        float height = dot(u_planes[i].xyz, origin) + u_planes[i].w;
        float slope = dot(u_planes[i].xyz, direction);
        if (slope == 0.0) {
            if (height < 0.0)
                return vec2(0.0);
            continue;
        }
        float edge = clamp(-height / slope / u_step - phase, -8.0e6, 8.0e6);
        if (slope > 0.0)
            range.x = max(range.x, ceil(edge));
        else
            range.y = min(range.y, floor(edge) + 1.0);
    }
    return range;
}
