// The ray of a pixel, affine in row and column, and the lattice of samples all rays share.
//
//   p(t) = P + t D      P = origin + row origin_row + col origin_col, D likewise
//   t_k = (k + phase) step, k an integer; phase is 1/2, or a hash of the pixel with jitter
//
// in:  u_origin*      voxels, x y z order (flipped from Rays.table)
//      u_direction*   voxels per mm of t;  u_step mm;  u_near mm, no sample at t <= near
//      frame buffer row 0 is image row 0: textures hold images top row first
// cpu twin: geometry/rays.py (Rays), rendering/cpu/ray_sampling.py (ray_of), rendering/cpu/compositing.py (phase_of)
// test:     tests/rendering/gl/test_glsl_functions.py

uniform vec3 u_origin;
uniform vec3 u_origin_row;
uniform vec3 u_origin_col;
uniform vec3 u_direction;
uniform vec3 u_direction_row;
uniform vec3 u_direction_col;
uniform float u_step;
uniform float u_near;

vec3 ray_origin(vec2 pixel) {
    return u_origin + pixel.y * u_origin_row + pixel.x * u_origin_col;
}

vec3 ray_direction(vec2 pixel) {
    return u_direction + pixel.y * u_direction_row + pixel.x * u_direction_col;
}

// Jimenez's interleaved gradient noise.
float jittered_phase(vec2 pixel) {
    return fract(52.9829189 * fract(dot(vec2(0.06711056, 0.00583715), pixel)));
}
