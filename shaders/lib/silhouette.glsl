// A soft outline and a drop shadow around a picture's silhouette, from its alpha alone.
//
//   outline(p) = max over a ring of radius r of alpha        shadow(p) = mean over a spiral disc
//
// in:  uv             (0, 0) top left, (1, 1) bottom right; outside the picture alpha is 0
//      u_texel        one picture pixel in uv
//      u_outline      straight RGBA;  u_outline_width  picture pixels
//      u_shadow       straight RGBA;  u_shadow_offset  picture pixels (right, down);
//      u_shadow_size  radius of the blur, picture pixels
// out: premultiplied RGBA to be put under the picture
// cpu twin: none; a decoration
// test:     tests/rendering/test_cards.py

uniform vec2 u_texel;
uniform vec4 u_outline;
uniform float u_outline_width;
uniform vec4 u_shadow;
uniform vec2 u_shadow_offset;
uniform float u_shadow_size;

vec4 picture_at(sampler2D picture, vec2 uv) {
    vec2 inside = step(vec2(0.0), uv) * step(uv, vec2(1.0));
    return texture2D(picture, uv) * inside.x * inside.y;
}

float ring(sampler2D picture, vec2 uv, vec2 radius) {
    float most = 0.0;
    for (int i = 0; i < 12; i++) {
        float angle = 0.5235988 * float(i);
        most = max(most, picture_at(picture, uv + radius * vec2(cos(angle), sin(angle))).a);
    }
    return most;
}

// Vogel's spiral spreads the taps evenly; the weights fall off like a Gaussian.
float blurred(sampler2D picture, vec2 uv, vec2 radius) {
    float sum = 0.0;
    float weights = 0.0;
    for (int i = 0; i < 24; i++) {
        float r = sqrt((float(i) + 0.5) / 24.0);
        float angle = 2.3999632 * float(i);
        float weight = exp(-2.0 * r * r);
        sum += weight * picture_at(picture, uv + r * radius * vec2(cos(angle), sin(angle))).a;
        weights += weight;
    }
    return sum / weights;
}

vec4 silhouette(sampler2D picture, vec2 uv) {
    float edge = u_outline.a * ring(picture, uv, u_outline_width * u_texel);
    float shade = u_shadow.a
        * blurred(picture, uv - u_shadow_offset * u_texel, u_shadow_size * u_texel);
    vec4 outline = vec4(u_outline.rgb, 1.0) * edge;
    return outline + (1.0 - outline.a) * vec4(u_shadow.rgb, 1.0) * shade;
}
