// SPDX-License-Identifier: Apache-2.0
// A mesh whose vertices are relit, from a camera that moves around it.
'use strict';

/// As OrbitCamera of relight/viewer/field/free_view.h; axes: +X right, +Y up, +Z ahead.
class OrbitCamera {
  constructor(start, height) {
    this.start = start;
    this.height = height;  // of the picture, pixels
    this.reset();
  }

  reset() {
    const {position, target, up, fov} = this.start;
    Object.assign(this, {position: [...position], target: [...target], up: [...up], fov});
  }

  static cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  }

  static unit(v) {
    const length = Math.hypot(...v);
    return v.map((x) => x / length);
  }

  offset() {
    return this.position.map((x, i) => x - this.target[i]);
  }

  /// To the right, above, ahead.
  axes() {
    const ahead = OrbitCamera.unit(this.offset().map((x) => -x)), right = OrbitCamera.unit(OrbitCamera.cross(this.up, ahead));
    return [right, OrbitCamera.cross(ahead, right), ahead];
  }

  /// Half the height of the picture at distance one.
  halfHeight() {
    return Math.tan(this.fov * Math.PI / 360);
  }

  orbit(rightDegrees, upDegrees) {
    const offset = this.offset(), length = Math.hypot(...offset), steepest = 89 * Math.PI / 180;
    const around = Math.atan2(offset[0], -offset[2]) + rightDegrees * Math.PI / 180;
    const height = Math.min(Math.max(Math.asin(offset[1] / length) + upDegrees * Math.PI / 180, -steepest), steepest);
    const direction = [Math.cos(height) * Math.sin(around), Math.sin(height), -Math.cos(height) * Math.cos(around)];
    this.position = this.target.map((x, i) => x + length * direction[i]);
    this.up = [0, 1, 0];
  }

  approach(factor) {
    const first = Math.hypot(...this.start.position.map((x, i) => x - this.start.target[i])), offset = this.offset();
    const length = Math.hypot(...offset), wanted = Math.min(Math.max(length / factor, 1e-3 * first), 1e3 * first);
    this.position = this.target.map((x, i) => x + offset[i] * wanted / length);
  }

  /// What is at the target moves by that many pixels.
  pan(right, down) {
    const [across, above] = this.axes(), scale = 2 * Math.hypot(...this.offset()) * this.halfHeight() / this.height;
    for (const point of [this.position, this.target])
      for (let i = 0; i < 3; ++i) point[i] += scale * (down * above[i] - right * across[i]);
  }
}

/// Vertices are relit into a texture; the mesh is drawn with them, once in motion and at rest four times with the lines of
/// sight of relight/mesh/mesh_raster.h; the mean is exposed and encoded.
class MeshRelighter extends Relighter {
  static sights = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];
  static outputsWidth = 2048;

  // A group of 16 outputs shares kernels; weights are bytes times the scale of their kernel.
  static outputsShader = `#version 300 es
    precision highp float;
    precision highp int;
    precision highp sampler2D;
    precision highp usampler2D;
    uniform usampler2D groups;        // of each group: first entry, number of entries
    uniform usampler2D entries;       // kernel, scale
    uniform usampler2D weights;       // 16 bytes for each entry and channel
    uniform sampler2D coefficients;
    uniform ivec2 entryLayout, kernelLayout;
    uniform int channels, outputs;
    uniform float gain;
    out vec4 colour;

    ${Relighter.placement}

    float weight(uint index, int within) {
      uint bytes = texelFetch(weights, place(index, entryLayout), 0)[within >> 2];
      return float((bytes >> (8 * (within & 3))) & 255u);
    }

    void main() {
      ivec2 pixel = ivec2(gl_FragCoord.xy);
      int output_ = pixel.y * ${MeshRelighter.outputsWidth} + pixel.x, group = output_ >> 4, within = output_ & 15;
      if (output_ >= outputs) discard;
      ivec2 size = textureSize(groups, 0);
      uvec2 range = texelFetch(groups, ivec2(group % size.x, group / size.x), 0).xy;
      vec3 sum = vec3(0.0);
      for (uint i = range.x; i < range.x + range.y; ++i) {
        uvec2 entry = texelFetch(entries, place(i, entryLayout), 0).xy;
        vec3 light = uintBitsToFloat(entry.y) * texelFetch(coefficients, place(entry.x, kernelLayout), 0).rgb;
        if (channels == 1) sum += weight(i, within) * light;
        else sum += vec3(weight(3u * i, within), weight(3u * i + 1u, within), weight(3u * i + 2u, within)) * light;
      }
      colour = vec4(sum * gain, 1.0);
    }`;

  // Outputs of glossy vertices are harmonics over the mirrored line of sight.
  static vertexShader = `#version 300 es
    precision highp float;
    precision highp int;
    precision highp sampler2D;
    layout(location = 0) in vec3 position;
    layout(location = 1) in vec3 reflectance;
    layout(location = 2) in vec3 normal;
    uniform sampler2D outputs;
    uniform int order;                // of the harmonics; 0: one output a vertex
    uniform mat3 axes;                // rows to the right, above, ahead
    uniform vec3 camera;
    uniform vec2 scale, shift, depths;
    out vec3 radiance;

    vec3 outputAt(int index) {
      return texelFetch(outputs, ivec2(index & ${MeshRelighter.outputsWidth - 1}, index >> ${Math.log2(MeshRelighter.outputsWidth)}), 0).rgb;
    }

    vec3 towards(vec3 direction, int first) {
      vec3 sum = vec3(0.0);
      float diagonal = 0.28209479177, cosine = 1.0, sine = 0.0;
      for (int m = 0; m < order; ++m) {
        float factor = m == 0 ? 1.0 : 1.41421356237, before = 0.0, now = diagonal;
        for (int l = m; l < order; ++l) {
          int middle = first + l * (l + 1);
          sum += factor * cosine * now * outputAt(middle + m);
          if (m > 0) sum += factor * sine * now * outputAt(middle - m);
          float next = float(l + 1), mm = float(m * m), ll = float(l * l);
          float grow = sqrt((4.0 * next * next - 1.0) / (next * next - mm));
          float back = l == m ? 0.0 : sqrt((ll - mm) / (4.0 * ll - 1.0));
          float after = grow * (direction.z * now - back * before);
          before = now;
          now = after;
        }
        float turned = direction.x * cosine - direction.y * sine;
        sine = direction.x * sine + direction.y * cosine;
        cosine = turned;
        diagonal *= sqrt(float(2 * m + 3) / float(2 * m + 2));
      }
      return sum;
    }

    void main() {
      vec3 seen = (position - camera) * axes;  // a row vector times the transposed
      gl_Position = vec4(seen.xy * scale + shift * seen.z,
                         (seen.z * (depths.x + depths.y) - 2.0 * depths.x * depths.y) / (depths.y - depths.x), seen.z);
      if (order == 0) {
        radiance = reflectance * outputAt(gl_VertexID);
      } else {
        vec3 sight = normalize(camera - position);
        radiance = reflectance * towards(2.0 * dot(normal, sight) * normal - sight, gl_VertexID * order * order);
      }
    }`;

  static fragmentShader = `#version 300 es
    precision highp float;
    in vec3 radiance;
    out vec4 colour;
    void main() {
      colour = vec4(gl_FrontFacing ? radiance : vec3(0.0), 1.0);
    }`;

  static pictureShader = `#version 300 es
    precision highp float;
    precision highp int;
    precision highp sampler2D;
    uniform sampler2D seen0, seen1, seen2, seen3;
    uniform int sights;
    uniform sampler2D sky;            // a panorama, for what the mesh does not cover
    uniform bool background;
    uniform mat3 axes;
    uniform vec2 halfSize;            // of the picture at distance one
    uniform vec2 pixels;
    uniform float gain;               // of the sky
    out vec4 colour;
    ${Relighter.encoding}
    vec3 skyTowards(vec2 place) {
      vec3 direction = normalize(axes * vec3(halfSize * (2.0 * place / pixels - 1.0), 1.0));
      ivec2 size = textureSize(sky, 0);
      vec2 turns = vec2(0.5 + atan(direction.x, direction.z) / 6.28318530718, acos(clamp(direction.y, -1.0, 1.0)) / 3.14159265359);
      return texelFetch(sky, clamp(ivec2(turns * vec2(size)), ivec2(0), size - 1), 0).rgb;
    }

    void main() {
      ivec2 at = ivec2(gl_FragCoord.xy);
      vec4 sum = texelFetch(seen0, at, 0);
      if (sights == 4) sum = 0.25 * (sum + texelFetch(seen1, at, 0) + texelFetch(seen2, at, 0) + texelFetch(seen3, at, 0));
      if (background && sum.a < 1.0) {
        vec3 behind = vec3(0.0);
        for (int i = 0; i < 4; ++i) behind += skyTowards(floor(gl_FragCoord.xy) + 0.25 + 0.5 * vec2(i & 1, i >> 1));
        sum.rgb += (1.0 - sum.a) * 0.25 * gain * behind;
      }
      colour = vec4(encoded(clamp(sum.rgb, 0.0, 1.0)), 1.0);
    }`;

  prepare() {
    const gl = this.gl, {mesh} = this.field;
    const exact = gl.getExtension('EXT_color_buffer_float');
    if (!exact && !gl.getExtension('EXT_color_buffer_half_float')) throw new Error('this browser cannot draw into textures of floats');
    this.format = exact ? gl.RGBA32F : gl.RGBA16F;
    this.camera = new OrbitCamera(mesh.camera, this.field.height);
    this.outputs = mesh.vertices * Math.max(1, mesh.order ** 2);
    this.relit = this.program = this.link(Relighter.vertexShader, MeshRelighter.outputsShader);
    gl.useProgram(this.program);
    this.uploadGroups();
    this.coefficients = this.texture(3, 'coefficients');
    gl.uniform2i(this.uniform('kernelLayout'), light.Projector.width - 1, Math.log2(light.Projector.width));
    this.drawn = this.link(MeshRelighter.vertexShader, MeshRelighter.fragmentShader);
    this.uploadMesh();
    this.prepareTargets();
    this.encodes = this.link(Relighter.vertexShader, MeshRelighter.pictureShader);
    this.background = false;
  }

  upload(unit, name, format, width, values) {
    const gl = this.gl, [layout, type] = {
      [gl.RG32UI]: [gl.RG_INTEGER, gl.UNSIGNED_INT], [gl.RGBA32UI]: [gl.RGBA_INTEGER, gl.UNSIGNED_INT],
    }[format];
    const size = format === gl.RG32UI ? 2 : 4, texels = values.length / size, height = Math.max(1, Math.ceil(texels / width));
    this.requireSize(width, height, 'the kernels');
    this.texture(unit, name);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    const whole = Math.floor(texels / width), rest = texels - whole * width;
    if (whole > 0) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, whole, layout, type, values);
    if (rest > 0) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, whole, rest, 1, layout, type, values, whole * width * size);
  }

  uploadGroups() {
    const gl = this.gl, {counts, kernels, scales, weights, mesh} = this.field, width = 1 << 12;
    const ranges = new Uint32Array(2 * counts.length), entries = new Uint32Array(2 * kernels.length);
    const bitsOfScales = new Uint32Array(scales.buffer);
    for (let g = 0, at = 0, i = 0; g < counts.length; ++g) {
      ranges[2 * g] = at;
      ranges[2 * g + 1] = counts[g];
      at += counts[g];
      for (let kernel = 0; i < at; ++i) {  // each but the first of a group as the difference to the one before
        kernel += kernels[i];
        entries[2 * i] = kernel;
        entries[2 * i + 1] = bitsOfScales[i];
      }
    }
    this.upload(0, 'groups', gl.RG32UI, 1 << 10, ranges);
    this.upload(1, 'entries', gl.RG32UI, width, entries);
    this.upload(2, 'weights', gl.RGBA32UI, width, new Uint32Array(weights.buffer));
    gl.uniform2i(this.uniform('entryLayout'), width - 1, Math.log2(width));
    gl.uniform1i(this.uniform('channels'), mesh.channels);
    gl.uniform1i(this.uniform('outputs'), this.outputs);
  }

  uploadMesh() {
    const gl = this.gl, {positions, colours, normals, triangles} = this.field;
    this.surface = gl.createVertexArray();
    gl.bindVertexArray(this.surface);
    [positions, colours, normals].forEach((values, place) => {
      if (values.length === 0) return;
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    const low = [Infinity, Infinity, Infinity], high = low.map((x) => -x);
    for (let i = 0; i < positions.length; ++i) {
      low[i % 3] = Math.min(low[i % 3], positions[i]);
      high[i % 3] = Math.max(high[i % 3], positions[i]);
    }
    this.middle = low.map((x, i) => (x + high[i]) / 2);
    this.radius = Math.hypot(...low.map((x, i) => high[i] - x)) / 2;
  }

  /// Textures of floats that are drawn into: one for the outputs, on unit 4, and one for each line of sight, from unit 5.
  /// On unit 9 that of the sky.
  prepareTargets() {
    const gl = this.gl, {width, height} = this.field, rows = Math.ceil(this.outputs / MeshRelighter.outputsWidth);
    this.requireSize(MeshRelighter.outputsWidth, rows, 'the vertices');
    const target = (unit, columns, lines) => {
      const texture = this.bindNewTexture(unit);
      gl.texStorage2D(gl.TEXTURE_2D, 1, this.format, columns, lines);
      const frame = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
      return frame;
    };
    this.outputRows = rows;
    this.outputFrame = target(4, MeshRelighter.outputsWidth, rows);
    const depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
    this.sightFrames = MeshRelighter.sights.map((_, i) => {
      const frame = target(5 + i, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
      return frame;
    });
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.bindNewTexture(9);
  }

  setCoefficients(values) {
    this.gl.activeTexture(this.gl.TEXTURE0 + this.coefficients);
    this.uploadCoefficients(values);
    this.outputGain = null;
  }

  describe() {
    return `${this.field.mesh.vertices.toLocaleString('en')} vertices`;
  }

  /// The panorama behind the mesh.
  setSky({width, height, values}) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + 9);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB32F, width, height, 0, gl.RGB, gl.FLOAT, values);
  }

  use(program) {
    this.program = program;
    this.gl.useProgram(program);
  }

  relight(gain) {
    if (this.outputGain === gain) return;
    const gl = this.gl;
    this.use(this.relit);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.outputFrame);
    gl.viewport(0, 0, MeshRelighter.outputsWidth, this.outputRows);
    gl.uniform1f(this.uniform('gain'), gain);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.outputGain = gain;
  }

  /// One line of sight a pixel, through the middle, or four.
  look(sights) {
    const gl = this.gl, camera = this.camera, {width, height, mesh} = this.field, half = camera.halfHeight(), axes = camera.axes();
    const ahead = axes[2].reduce((sum, x, i) => sum + x * (this.middle[i] - camera.position[i]), 0);
    const far = Math.max(ahead + this.radius, 1e-6 * this.radius) * 1.001, near = Math.max(ahead - this.radius, far * 1e-3) * 0.999;
    this.use(this.drawn);
    gl.uniform1i(this.uniform('outputs'), 4);
    gl.uniform1i(this.uniform('order'), mesh.order);
    gl.uniformMatrix3fv(this.uniform('axes'), false, axes.flat());  // columns: what is multiplied from the left
    gl.uniform3fv(this.uniform('camera'), camera.position);
    gl.uniform2f(this.uniform('scale'), height / (width * half), 1 / half);
    gl.uniform2f(this.uniform('depths'), near, far);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    gl.frontFace(gl.CW);  // axes are left-handed
    gl.bindVertexArray(this.surface);
    sights.forEach(([x, y], i) => {
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.sightFrames[i]);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniform2f(this.uniform('shift'), (1 - 2 * x) / width, (2 * y - 1) / height);
      gl.drawElements(gl.TRIANGLES, this.field.triangles.length, gl.UNSIGNED_INT, 0);
    });
    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
  }

  draw(exposure, spacing = 1) {
    const gl = this.gl, camera = this.camera, {width, height} = this.field, half = camera.halfHeight();
    const sights = spacing > 1 ? [[0.5, 0.5]] : MeshRelighter.sights;
    this.relight(exposure);
    this.look(sights);
    this.use(this.encodes);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    for (let i = 0; i < 4; ++i) gl.uniform1i(this.uniform(`seen${i}`), 5 + i);
    gl.uniform1i(this.uniform('sights'), sights.length);
    gl.uniform1i(this.uniform('sky'), 9);
    gl.uniform1i(this.uniform('background'), this.background ? 1 : 0);
    gl.uniform1f(this.uniform('gain'), exposure);
    gl.uniformMatrix3fv(this.uniform('axes'), false, camera.axes().flat());
    gl.uniform2f(this.uniform('halfSize'), half * width / height, half);
    gl.uniform2f(this.uniform('pixels'), width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /// As exposure_to_white() of the picture from the present camera, without background.
  exposureToWhite() {
    const gl = this.gl, {width, height} = this.field, seen = new Float32Array(width * height * 4), sum = new Float32Array(seen.length);
    this.relight(1);
    this.look(MeshRelighter.sights);
    for (const frame of this.sightFrames) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, seen);
      for (let i = 0; i < seen.length; ++i) sum[i] += 0.25 * seen[i];
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return Relighter.whiteOf(Float32Array.from({length: width * height}, (_, p) => Math.max(sum[4 * p], sum[4 * p + 1], sum[4 * p + 2])));
  }
}
