// Blinn-Phong with the lamp at the viewer's head, two-sided, fading out where nothing is steep.
//
//   c = |n . l|, s = min(|g| / floor, 1)
//   light = ambient + diffuse (1 - s + s c)      highlight = specular s c^shininess
//
// in:  gradient       per min(spacing) mm of world, x y z, density texture's unit
//      along          unit direction of the ray, world, x y z
//      u_light        ambient, diffuse, specular, shininess
//      u_steepness    1 / floor
// out: (light, highlight)
// cpu twin: geometry/shading.py, rendering/cpu/compositing.py (_light, shade)
// test:     tests/rendering/gl/test_glsl_functions.py

uniform vec4 u_light;
uniform float u_steepness;

vec2 light_of(vec3 gradient, vec3 along) {
    float steep = length(gradient);
    if (steep <= 0.0)
        return vec2(u_light.x + u_light.y, 0.0);
    float c = min(abs(dot(gradient, along)) / steep, 1.0);
    float s = min(steep * u_steepness, 1.0);
    float shine = c > 0.0 ? pow(c, u_light.w) : 0.0;
    return vec2(u_light.x + u_light.y * (1.0 - s + s * c), u_light.z * s * shine);
}
