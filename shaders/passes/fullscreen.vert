// One quad over the whole frame buffer; the fragment shaders work from gl_FragCoord.
//
// in:  a_position     corners, NDC
// cpu twin: none
// test:     tests/rendering/gl/test_parity.py

attribute vec2 a_position;

void main() {
    gl_Position = vec4(a_position, 0.0, 1.0);
}
