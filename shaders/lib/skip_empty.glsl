// Leaps over bricks in which nothing can be seen, landing on the ray's own lattice.
//
//   d = chessboard distance, in bricks, to the nearest occupied brick; 0: look here
//   the cube of bricks within d - 1 is empty: the next k is the first that may lie outside it
//
// in:  u_leaps        d / 255, one texel a brick of BRICK voxels;  u_bricks its size, x y z
//      voxel          nearest voxel of the sample, x y z
// out: k of the next sample that may matter; errs on the side of too few skipped
// cpu twin: raycasting/lattice.py (leap), raycasting/bricks.py (strides)
// test:     tests/rendering/test_parity.py

#include "lib/ray.glsl"

#define BRICK 8.0

uniform sampler3D u_leaps;
uniform vec3 u_bricks;
uniform float u_skip;

float brick_distance(vec3 voxel) {
    vec3 brick = floor(voxel / BRICK);
    return floor(texture3D(u_leaps, (brick + 0.5) / u_bricks).r * 255.0 + 0.5);
}

float leap(float away, vec3 voxel, float k, vec3 origin, vec3 direction, float phase) {
    vec3 corner = floor(voxel / BRICK) * BRICK - 0.5;
    float reach = max(away, 1.0) * BRICK;
    vec3 forward = corner + reach;
    vec3 backward = corner + BRICK - reach;
    vec3 wall = mix(backward, forward, vec3(greaterThan(direction, vec3(0.0))));
    // Along a zero component there is no wall to reach.
    float t = 1.0e20;
    if (abs(direction.x) > 1.0e-20) t = min(t, (wall.x - origin.x) / direction.x);
    if (abs(direction.y) > 1.0e-20) t = min(t, (wall.y - origin.y) / direction.y);
    if (abs(direction.z) > 1.0e-20) t = min(t, (wall.z - origin.z) / direction.z);
    return max(k + 1.0, ceil(t / u_step - phase - 1.0e-3));
}
