// The density's gradient: central differences one voxel to both sides.
//
//   g_i = (d(p + e_i) - d(p - e_i)) / 2     per voxel, in the density texture's unit
//
// in:  p              voxels, x y z
// cpu twin: raycasting/chunks.py (differentiate)
// test:     tests/rendering/test_probes.py

#include "lib/density.glsl"

vec3 gradient_at(vec3 p) {
    return 0.5 * vec3(
        density_at(p + vec3(1.0, 0.0, 0.0)) - density_at(p - vec3(1.0, 0.0, 0.0)),
        density_at(p + vec3(0.0, 1.0, 0.0)) - density_at(p - vec3(0.0, 1.0, 0.0)),
        density_at(p + vec3(0.0, 0.0, 1.0)) - density_at(p - vec3(0.0, 0.0, 1.0)));
}
