// A quad: one textured rectangle, full screen, an object's box, or a sprite.
//
//   clip(u, v) = origin + u right + v down            (affine: a rectangle stays a parallelogram)
//
// in:  a_corner       corner of the quad, 0 or 1: right, down the image
//      u_clip_*       the image's top left corner and its two edges, clip space
// out: v_uv           texture coordinates, (0, 0) the image's top left corner
// cpu twin: rendering/gl/depth_quads.py (Place.frame)
// test:     tests/rendering/gl/test_depth_quads.py

attribute vec2 a_corner;

uniform vec4 u_clip_origin;
uniform vec4 u_clip_right;
uniform vec4 u_clip_down;

varying vec2 v_uv;

void main() {
    v_uv = a_corner;
    vec4 corner = u_clip_origin + v_uv.x * u_clip_right + v_uv.y * u_clip_down;
    // Depth is the fragment shader's; z = 0 keeps the near and far planes from cutting the card.
    gl_Position = vec4(corner.xy, 0.0, corner.w);
}
