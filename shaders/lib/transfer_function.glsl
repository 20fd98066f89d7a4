// The master transfer function: a table over density, interpolated linearly, clamped (C0).
//
//   u = clamp((density - lo) / (hi - lo) (K - 1), 0, K - 1),  entries floor(u), floor(u) + 1
//
// in:  u_table        K x 1 texels of straight RGB and opacity per voxel, nearest
//      u_table_size   K
//      u_entry        (scale, offset) from the density texture's unit to u
// cpu twin: rendering/cpu/compositing.py (_light), rendering/cpu/simd/arithmetic.py (look_up)
// test:     tests/rendering/gl/test_glsl_functions.py

uniform sampler2D u_table;
uniform float u_table_size;
uniform vec2 u_entry;

vec4 transfer(float density) {
    float u = clamp(density * u_entry.x + u_entry.y, 0.0, u_table_size - 1.0);
    // Linear filtering in hardware has 8 bits of weight; a texel centre and mix have all of them.
    float entry = min(floor(u), u_table_size - 2.0);
    float row = 1.0 / u_table_size;
    vec4 below = texture2D(u_table, vec2((entry + 0.5) * row, 0.5));
    vec4 above = texture2D(u_table, vec2((entry + 1.5) * row, 0.5));
    return mix(below, above, u - entry);
}
