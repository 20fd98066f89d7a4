// Leaps over bricks in which nothing can be seen, landing on the ray's own lattice, and over the
// asking where all bricks around hold something.
//
//   d = chessboard distance, in bricks, to the nearest brick of the other kind, positive in empty
//   bricks (leap), negative in occupied ones (look)
//   the cube of bricks within |d| - 1 is alike: the next k is the first that may lie outside it
//
// in:  u_leaps        (128 + d) / 255, one texel a brick of BRICK voxels;  u_bricks its size, x y z
//      voxel          nearest voxel of the sample, x y z
// out: k from which to ask again; errs on the side of too early
// cpu twin: rendering/cpu/ray_sampling.py (leap), rendering/cpu/bricks.py (Strides)
// test:     tests/rendering/gl/test_parity.py

#include "lib/ray.glsl"

#define BRICK 8.0

uniform sampler3D u_leaps;
uniform vec3 u_bricks;
uniform float u_skip;

float brick_distance(vec3 voxel) {
    vec3 brick = floor(voxel / BRICK);
    return floor(texture3D(u_leaps, (brick + 0.5) / u_bricks).r * 255.0 + 0.5) - 128.0;
}

float leap(float away, vec3 voxel, float k, vec3 origin, vec3 direction, float phase) {
    // From the brick's middle to its walls, in samples; along a zero component they are far away.
    vec3 pace = 1.0 / (max(abs(direction), 1.0e-20) * u_step);
    vec3 middle = (floor(voxel / BRICK) + 0.5) * BRICK - 0.5;
    vec3 edge = ((middle - origin) * sign(direction) + (abs(away) - 0.5) * BRICK) * pace;
    return max(k + 1.0, ceil(min(min(edge.x, edge.y), edge.z) - phase - 1.0e-3));
}
