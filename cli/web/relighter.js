// SPDX-License-Identifier: Apache-2.0
// image = transfer · coefficients, a fragment a pixel (WebGL 2).
'use strict';

class Relighter {
  static vertexShader = `#version 300 es
    void main() {
      gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
    }`;

  static encoding = `
    vec3 encoded(vec3 linear) {
      return mix(1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055, 12.92 * linear,
                 vec3(lessThanEqual(linear, vec3(0.0031308))));
    }`;

  // Where a value of a list lies in its texture; `size`: mask of the column, shift to the row.
  static placement = `
    ivec2 place(uint index, ivec2 size) {
      return ivec2(int(index) & size.x, int(index) >> size.y);
    }`;

  // Weights: three mantissas of 9 bits and a shared exponent of 5, see packed_field.h.
  static fragmentShader = `#version 300 es
    precision highp float;
    precision highp int;
    precision highp sampler2D;
    precision highp usampler2D;
    uniform usampler2D rows;          // of each pixel: first entry, number of entries
    uniform usampler2D entries;       // kernel, weights
    uniform sampler2D coefficients;   // of each kernel
    uniform ivec2 entryLayout, kernelLayout;
    uniform int height;               // of the canvas
    uniform int spacing;              // of drawn pixels; above 1 in a draft
    uniform float gain;
    uniform mat3 mixing;              // of the primaries of the light in the camera's channels
    out vec4 colour;

    ${Relighter.placement}
    ${Relighter.encoding}

    void main() {
      ivec2 drawn = ivec2(gl_FragCoord.xy) * spacing;
      ivec2 pixel = ivec2(drawn.x, height - 1 - drawn.y);
      if (pixel.x >= textureSize(rows, 0).x || pixel.y < 0) discard;
      uvec2 row = texelFetch(rows, pixel, 0).xy;
      vec3 sum = vec3(0.0);
      for (uint i = row.x; i < row.x + row.y; ++i) {
        uvec2 entry = texelFetch(entries, place(i, entryLayout), 0).xy;
        vec3 mantissa = vec3(uvec3(entry.y, entry.y >> 9, entry.y >> 18) & 511u);
        float power = uintBitsToFloat(((entry.y >> 27) + 127u) << 23);
        sum += mantissa * power * texelFetch(coefficients, place(entry.x, kernelLayout), 0).rgb;
      }
      colour = vec4(encoded(clamp(mixing * sum * gain, 0.0, 1.0)), 1.0);
    }`;

  constructor(canvas, field) {
    this.field = field;
    canvas.width = field.width;
    canvas.height = field.height;
    const gl = this.gl = canvas.getContext('webgl2', {alpha: false, antialias: false, depth: false});
    if (!gl) throw new Error('this browser has no WebGL 2');
    this.largest = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    this.prepare();
  }

  prepare() {
    const gl = this.gl;
    this.program = this.link(Relighter.vertexShader, Relighter.fragmentShader);
    gl.useProgram(this.program);
    ['rows', 'entries', 'coefficients'].forEach((name, unit) => gl.uniform1i(this.uniform(name), unit));
    gl.uniform1i(this.uniform('height'), this.field.height);
    gl.uniformMatrix3fv(this.uniform('mixing'), true, this.field.mixing);
    gl.uniform2i(this.uniform('kernelLayout'), light.Projector.width - 1, Math.log2(light.Projector.width));
    this.uploadRows(this.field);
    this.uploadEntries(this.field);
    this.bindNewTexture(2);  // coefficients
  }

  uniform(name) {
    return this.gl.getUniformLocation(this.program, name);
  }

  link(vertexShader, fragmentShader) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertexShader], [gl.FRAGMENT_SHADER, fragmentShader]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  bindNewTexture(unit) {
    const gl = this.gl, texture = gl.createTexture();
    this.bind(texture, unit);
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
    return texture;
  }

  bind(texture, unit) {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, texture);
  }

  requireSize(width, height, what) {
    if (width > this.largest || height > this.largest)
      throw new Error(`${what} do not fit this browser's largest texture (${this.largest}); export a smaller field`);
  }

  uploadRows({width, height, starts}) {
    const gl = this.gl;
    this.requireSize(width, height, 'the pixels');
    const values = new Uint32Array(width * height * 2);
    for (let p = 0; p < width * height; ++p) {
      values[2 * p] = starts[p];
      values[2 * p + 1] = starts[p + 1] - starts[p];
    }
    this.bindNewTexture(0);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG32UI, width, height, 0, gl.RG_INTEGER, gl.UNSIGNED_INT, values);
  }

  /// In bands, so that the interleaved copy stays small.
  uploadEntries({kernels, weights}) {
    const gl = this.gl, count = kernels.length;
    const shift = Math.floor(Math.log2(Math.min(this.largest, 8192))), width = 1 << shift;
    const height = Math.max(1, Math.ceil(count / width)), band = 64;
    this.requireSize(width, height, 'the kernels');
    this.bindNewTexture(1);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RG32UI, width, height);
    const values = new Uint32Array(width * band * 2);
    for (let top = 0; top < height; top += band) {
      const first = top * width, last = Math.min(count, first + width * band);
      for (let i = first, to = 0; i < last; ++i) {
        values[to++] = kernels[i];
        values[to++] = weights[i];
      }
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, top, width, Math.min(band, height - top), gl.RG_INTEGER, gl.UNSIGNED_INT, values);
    }
    gl.uniform2i(this.uniform('entryLayout'), width - 1, shift);
  }

  setCoefficients(values) {
    const gl = this.gl, width = light.Projector.width, height = values.length / 4 / width;
    gl.activeTexture(gl.TEXTURE2);
    this.requireSize(width, height, 'the boxes');
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, values);
  }

  /// The exposure at which fewer than 1 % of the lit pixels are white, as exposure_to_white() of core/image/tone_map.h.
  exposureToWhite(coefficients) {
    const {starts, kernels, weights, exponentOffset, mixing} = this.field;
    const brightest = new Float32Array(starts.length - 1), sum = [0, 0, 0];
    for (let p = 0; p < brightest.length; ++p) {
      sum.fill(0);
      for (let i = starts[p]; i < starts[p + 1]; ++i) {
        const power = 2 ** ((weights[i] >>> 27) - exponentOffset);
        for (let c = 0; c < 3; ++c) sum[c] += ((weights[i] >>> (9 * c)) & 511) * power * coefficients[4 * kernels[i] + c];
      }
      brightest[p] = Math.max(...[0, 3, 6].map((row) => mixing[row] * sum[0] + mixing[row + 1] * sum[1] + mixing[row + 2] * sum[2]));
    }
    return Relighter.whiteOf(brightest);
  }

  static whiteOf(brightest) {
    const lit = brightest.filter((value) => value > 0).sort();
    return lit.length === 0 ? 1 : 1 / lit[Math.min(Math.ceil(0.99 * lit.length), lit.length - 1)];
  }

  /// With `spacing` above 1 a draft: every so manieth pixel in each direction, enlarged.
  draw(exposure, spacing = 1) {
    const gl = this.gl, {width, height} = this.field;
    const columns = Math.ceil(width / spacing), rows = Math.ceil(height / spacing);
    const target = spacing > 1 ? this.draftTarget() : null;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.viewport(0, 0, columns, rows);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.uniform1i(this.uniform('spacing'), spacing);
    gl.uniform1f(this.uniform('gain'), exposure * 2 ** -this.field.exponentOffset);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    if (!target) return;
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, columns, rows, 0, 0, columns * spacing, rows * spacing, gl.COLOR_BUFFER_BIT, gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /// What the page says of the picture.
  describe() {
    return `${this.field.width}×${this.field.height} pixels`;
  }

  /// As large as the largest draft; made when first asked for.
  draftTarget() {
    const gl = this.gl;
    if (this.draft) return this.draft;
    const colour = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, colour);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, Math.ceil(this.field.width / 2), Math.ceil(this.field.height / 2));
    this.draft = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.draft);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, colour);
    return this.draft;
  }

  /// What was just drawn, row by row from the top, RGBA. To be called in the same task as draw().
  readPixels(x = 0, y = 0, width = this.field.width, height = this.field.height) {
    const gl = this.gl, upsideDown = new Uint8Array(width * height * 4), result = new Uint8Array(upsideDown.length);
    gl.readPixels(x, this.field.height - y - height, width, height, gl.RGBA, gl.UNSIGNED_BYTE, upsideDown);
    for (let row = 0; row < height; ++row)
      result.set(upsideDown.subarray((height - 1 - row) * width * 4, (height - row) * width * 4), row * width * 4);
    return result;
  }
}
