// The density's gradient: central differences one voxel to both sides.
//
//   g_i = (d(p + e_i) - d(p - e_i)) / 2     per voxel, in the density texture's unit
//
// in:  p              voxels, x y z
// cpu twin: rendering/cpu/brick_cache.py (fill), rendering/cpu/simd/arithmetic.py (blend_cell)
// test:     tests/rendering/gl/test_glsl_functions.py

#include "lib/density.glsl"

vec3 gradient_at(vec3 p) {
    vec3 voxel = u_per_factor * u_per_grid;
    vec3 uv = (p + 0.5) * voxel;
    vec3 x = vec3(voxel.x, 0.0, 0.0);
    vec3 y = vec3(0.0, voxel.y, 0.0);
    vec3 z = vec3(0.0, 0.0, voxel.z);
    return 0.5 * vec3(
        texture3D(u_density, uv + x).r - texture3D(u_density, uv - x).r,
        texture3D(u_density, uv + y).r - texture3D(u_density, uv - y).r,
        texture3D(u_density, uv + z).r - texture3D(u_density, uv - z).r);
}
