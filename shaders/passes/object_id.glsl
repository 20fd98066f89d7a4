// The distinct visible objects on a ray, nearest first: four layers a pass.
//
//   every sample counts as opaque (Li et al. 2012, section 4.2); depth peeling is per pixel:
//   layer k holds the k-th object the ray meets that earlier layers do not
//
// in:  lib/ray.glsl, lib/label_lookup.glsl
//      u_visible      red > 1/2 where the object of this ID counts;  u_visible_rows its height
//      u_found_*      earlier passes' results, FOUND of them (a define), one texel a pixel
//      u_size         pixels: width, height
//      u_wanted       layers to fill in this pass, 1 to 4
// out: four IDs, exact floats, 0 where there is none
// cpu twin: rendering/cpu/object_ids.py
// test:     tests/rendering/gl/test_parity.py

#include "lib/pixel.glsl"
#include "lib/ray_box.glsl"
#include "lib/skip_empty.glsl"
#include "lib/label_lookup.glsl"

uniform sampler2D u_visible;
uniform float u_visible_rows;
uniform vec2 u_size;
uniform float u_wanted;
#if FOUND > 0
uniform sampler2D u_found_0;
#endif
#if FOUND > 1
uniform sampler2D u_found_1;
#endif
#if FOUND > 2
uniform sampler2D u_found_2;
#endif
#if FOUND > 3
uniform sampler2D u_found_3;
#endif
#if FOUND > 4
uniform sampler2D u_found_4;
#endif
#if FOUND > 5
uniform sampler2D u_found_5;
#endif
#if FOUND > 6
uniform sampler2D u_found_6;
#endif

bool among(vec4 ids, float id) {
    return any(equal(ids, vec4(id)));
}

bool found_before(vec2 uv, float id) {
#if FOUND > 0
    if (among(texture2D(u_found_0, uv), id)) return true;
#endif
#if FOUND > 1
    if (among(texture2D(u_found_1, uv), id)) return true;
#endif
#if FOUND > 2
    if (among(texture2D(u_found_2, uv), id)) return true;
#endif
#if FOUND > 3
    if (among(texture2D(u_found_3, uv), id)) return true;
#endif
#if FOUND > 4
    if (among(texture2D(u_found_4, uv), id)) return true;
#endif
#if FOUND > 5
    if (among(texture2D(u_found_5, uv), id)) return true;
#endif
#if FOUND > 6
    if (among(texture2D(u_found_6, uv), id)) return true;
#endif
    return false;
}

void main() {
    if (OUTSIDE)
        return;
    vec2 pixel = PIXEL;
    vec2 uv = (pixel + 0.5) / u_size;
    vec3 origin = ray_origin(pixel);
    vec3 direction = ray_direction(pixel);
    vec2 range = sample_range(origin, direction, 0.5);
    vec4 ids = vec4(0.0);
    float count = 0.0;
    float previous = 0.0;
    float k = range.x;
    float skip_from = u_skip > 0.5 ? k : range.y;
    while (k < range.y && count < u_wanted) {
        while (k < range.y && k >= skip_from) {
            vec3 voxel = floor(origin + (k + 0.5) * u_step * direction + 0.5);
            float away = brick_distance(voxel);
            skip_from = leap(away, voxel, k, origin, direction, 0.5);
            k = away > 0.0 ? skip_from : k;
        }
        if (k >= range.y)
            break;
        vec3 voxel = floor(origin + (k + 0.5) * u_step * direction + 0.5);
        k += 1.0;
        float id = label_at(voxel);
        if (id == previous)
            continue;
        previous = id;
        if (table_row(u_visible, u_visible_rows, id).r < 0.5 || among(ids, id) || found_before(uv, id))
            continue;
        if (count < 0.5) ids.x = id;
        else if (count < 1.5) ids.y = id;
        else if (count < 2.5) ids.z = id;
        else ids.w = id;
        count += 1.0;
    }
    WRITE_0(ids);
}
