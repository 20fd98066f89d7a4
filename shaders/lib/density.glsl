// The density at a point: trilinear between voxel centres at integers, clamped at the edges.
//
//   uv = (p + 1/2) / (texels voxels-a-texel)
//
// in:  u_density      8 or 16 bit normalised or float texture, linear, clamped to its edge
//      p              voxels, x y z, full resolution
// out: the texture's own unit; lib/transfer_function.glsl knows the scale
// cpu twin: rendering/cpu/ray_sampling.py (density_at)
// test:     tests/rendering/gl/test_glsl_functions.py

#include "lib/label_lookup.glsl"

uniform sampler3D u_density;

float density_at(vec3 p) {
    return texture3D(u_density, (p + 0.5) * (u_per_factor * u_per_grid)).r;
}
