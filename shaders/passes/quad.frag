// A quad's colour and depth, in two draws that share its pixels out between them:
//   core (u_core = 1)  where the image's alpha reached 1/2; these write depth
//   rest (u_core = 0)  all others; tested against depth, never writing it
//
//   z_ndc(t) = (a t + b) / (c t + d)     t: mm from the pivot plane, away from the viewer
//
// in:  v_uv           (0, 0) at the image's top left corner, (1, 1) at its bottom right one
//      u_image      premultiplied RGBA
//      u_before       the image it comes from, same pixels;  u_mix  share of the new one
//      u_depth        red: t where alpha first reached 1/2, mm; NO_DEPTH or more where never
//      u_has_depth    0 where the image has no depths: alpha >= 1/2 is then core, at u_t
//      u_t            mm: plane of what has no depth;  u_t_origin mm: added to the depths read
//      u_z_of_t       (a, b, c, d)
//      u_opacity      of the quad as a whole
// out: premultiplied RGBA, window depth
// cpu twin: rendering/gl/depth_quads.py (depth_row)
// test:     tests/rendering/gl/test_depth_quads.py

#include "lib/no_depth.glsl"

uniform sampler2D u_image;
uniform sampler2D u_before;
uniform float u_mix;
uniform sampler2D u_depth;
uniform float u_has_depth;
uniform float u_core;
uniform float u_t;
uniform float u_t_origin;
uniform vec4 u_z_of_t;
uniform float u_opacity;

varying vec2 v_uv;

void main() {
    vec4 color = texture2D(u_image, v_uv);
    if (u_mix < 1.0)
        color = mix(texture2D(u_before, v_uv), color, u_mix);
    float t = u_t;
    bool solid = color.a * u_opacity >= 0.5;
    if (u_has_depth > 0.5) {
        float read = texture2D(u_depth, v_uv).r;
        if (read < NO_DEPTH)
            t = read + u_t_origin;
        else
            solid = false;
    }
    if (solid != (u_core > 0.5))
        discard;
    color *= u_opacity;
    if (color.a <= 0.0)
        discard;
    float w = u_z_of_t.z * t + u_z_of_t.w;
    float z = w > 0.0 ? (u_z_of_t.x * t + u_z_of_t.y) / w : -1.0;
    gl_FragColor = color;
    gl_FragDepth = clamp(0.5 + 0.5 * z, 0.0, 1.0);
}
