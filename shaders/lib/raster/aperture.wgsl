// Side of the square in a pixel's middle that is sensitive to light, px: `Camera.pixel_side`.
override aperture: f32 = 1.0;
