// The page's view: the mesh cut open by a plane, drawn with three.js (WebGL 2).
//
// What it draws comes from engine/mesh_view, encoded by tools/page_data.cpp. Positions are whole
// numbers from 0 to 65535, in steps of `view.step` from `view.origin`.
//   - A small mesh has all its cells: its boundary is drawn beyond the plane, and the cells that
//     the plane meets, whole or cut flat.
//   - Of a larger one the input surface is drawn, closed at the plane by a cap in the colors of the
//     leaves; where the plane is one whose cells are in the page, by these cells.
'use strict';

(() => {
  const AXES = ['x', 'y', 'z'];
  const GRAY = [197, 203, 211];

  // -- Data --------------------------------------------------------------------------------------

  const view = JSON.parse(document.getElementById('view-data').textContent);

  async function inflate(id) {
    const text = atob(document.getElementById(id).textContent);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  // Byte planes, lowest first, of `count` numbers.
  function fromPlanes(bytes, at, count, size, out, stride, offset) {
    for (let i = 0; i < count; ++i) {
      let value = 0;
      for (let b = 0; b < size; ++b) value += bytes[at + b * count + i] * 2 ** (8 * b);
      out[i * stride + offset] = value;
    }
    return at + size * count;
  }

  // Each axis as steps modulo 2^16.
  async function positionsOf(set) {
    const bytes = await inflate(set.vertices), n = set.num_vertices;
    const out = new Uint16Array(3 * n);
    for (let axis = 0, at = 0; axis < 3; ++axis) {
      at = fromPlanes(bytes, at, n, 2, out, 3, axis);
      for (let i = 1; i < n; ++i) out[3 * i + axis] += out[3 * i - 3 + axis];
    }
    return out;
  }

  // A vertex is named by how many had been named before it, less its index: 0 is the next new one.
  async function indicesOf(id, count, corners) {
    const bytes = await inflate(id);
    const out = new Uint32Array(count * corners);
    for (let corner = 0, at = 0; corner < corners; ++corner)
      at = fromPlanes(bytes, at, count, 4, out, corners, corner);
    let known = 0;
    for (let i = 0; i < out.length; ++i) {
      const reference = out[i];
      out[i] = known - reference;
      if (reference === 0) ++known;
    }
    return out;
  }

  async function loadCells(set) {
    const cells = {...set, count: set.num_cells};
    cells.positions = await positionsOf(set);
    cells.corners = await indicesOf(set.cells, set.num_cells, 4);
    cells.angle = await inflate(set.min_dihedral_degrees);
    cells.ratio = await inflate(set.radius_edge_ratios);
    if (set.circumradii) cells.radius = await inflate(set.circumradii);
    cells.leaf = await runsOf(set.leaves, set.num_cells);
    cells.body = set.bodies ? await runsOf(set.bodies, set.num_cells) : null;
    if (set.boundary) cells.boundary = await inflate(set.boundary);
    if (set.sheets) cells.sheets = await sheetsOf(set.sheets);
    cells.blocks = blocksOf(cells);
    return cells;
  }

  // A value of each cell, from pairs of a value and how many cells have it.
  async function runsOf(id, count) {
    const runs = new Uint32Array((await inflate(id)).buffer), values = new Uint32Array(count);
    for (let i = 0, cell = 0; i < runs.length; i += 2)
      for (let n = 0; n < runs[i + 1]; ++n) values[cell++] = runs[i];
    return values;
  }

  async function sheetsOf(id) { return new Uint32Array((await inflate(id)).buffer); }

  // Boxes around runs of cells, so that few cells are asked whether a plane meets them.
  const BLOCK = 256;
  function blocksOf({corners, positions, count}) {
    const boxes = new Uint16Array(6 * Math.ceil(count / BLOCK));
    for (let block = 0; block * BLOCK < count; ++block) {
      const low = [65535, 65535, 65535], high = [0, 0, 0];
      const end = Math.min(count, (block + 1) * BLOCK);
      for (let i = 4 * block * BLOCK; i < 4 * end; ++i)
        for (let axis = 0; axis < 3; ++axis) {
          const p = positions[3 * corners[i] + axis];
          if (p < low[axis]) low[axis] = p;
          if (p > high[axis]) high[axis] = p;
        }
      boxes.set([...low, ...high], 6 * block);
    }
    return boxes;
  }

  // -- Colors ------------------------------------------------------------------------------------

  function hsl(h, s, l) {
    const f = n => {
      const k = (n + h / 30) % 12;
      return Math.round(255 * (l - s * Math.min(l, 1 - l) * Math.max(-1, Math.min(k - 3, 9 - k, 1))));
    };
    return [f(0), f(8), f(4)];
  }

  function ramp(stops, t) {
    const x = Math.max(0, Math.min(1, t)) * (stops.length - 1);
    const i = Math.min(Math.floor(x), stops.length - 2), f = x - i;
    return stops[i].map((c, k) => Math.round(c + f * (stops[i + 1][k] - c)));
  }

  // From bad to good: told apart in print and by the color-blind.
  const QUALITY = [[165, 0, 38], [244, 109, 67], [254, 224, 144], [171, 217, 233], [69, 117, 180]];
  const COUNT = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const STATES = {damaged: [214, 39, 40], unvisited: [190, 190, 190], waiting: [255, 158, 74],
                  clean: [76, 146, 195], core: [123, 181, 117]};

  const leaves = view.leaves;
  const range = values => [values.reduce((a, b) => Math.min(a, b), Infinity),
                           values.reduce((a, b) => Math.max(a, b), 0)];
  const counted = (values, label) => {
    const [low, high] = range(values);
    const color = value => ramp(COUNT, high > low ? (value - low) / (high - low) : 0.5);
    return {
      leaf: i => color(values[i]),
      legend: () => swatches(Array.from({length: Math.min(12, high - low + 1)}, (_, i) => {
        const value = Math.round(low + i * (high - low) / Math.max(1, Math.min(11, high - low)));
        return [String(value), color(value)];
      }), label),
    };
  };
  // A quality is a byte: see page_data.cpp.
  const measured = (name, worst, best, unit, label) => ({
    cell: (cells, i) => ramp(QUALITY, (cells[name][i] / 255 * (view.quality[name][1] -
      view.quality[name][0]) + view.quality[name][0] - worst) / (best - worst)),
    legend: () => gradient(QUALITY, worst, best, unit, label),
  });

  // A radius is a byte, of its logarithm: see page_data.cpp.
  const sized = ([low, high]) => ({
    cell: (cells, i) => ramp(COUNT, cells.radius[i] / 255),
    legend: () => swatches([0, 1, 2, 3, 4, 5, 6].map(i => i / 6).reverse().map(t =>
      [(2 ** (low + t * (high - low))).toPrecision(3), ramp(COUNT, t)]),
      'circumradius of the cell'),
  });

  // By id, from 1 on; 0 is of none.
  function sheetColor(id) {
    return id === 0 ? GRAY : hsl((id * 137.508) % 360, 0.45 + 0.2 * (id % 3) / 2,
                                 0.56 + 0.16 * ((id >> 1) % 3) / 2);
  }
  function sheetLegend() {
    const most = 40, {name} = view.sheets;
    return swatches(name.slice(0, most).map((text, i) => [escaped(text), sheetColor(i + 1)]),
                    'sheet: point at one for its area') +
      (name.length > most ? note(`and ${name.length - most} more`) : '');
  }

  const COLORS = {
    leaf: {title: 'octree leaf', leaf: i => hsl((i * 137.508) % 360, 0.42 + 0.2 * (i % 3) / 2,
             0.6 + 0.14 * ((i >> 1) % 3) / 2),
           legend: () => note((leaves.level.length === 1 ? 'There is one leaf' :
             `One color for each of ${leaves.level.length} leaves`) +
             (view.are_leaves_merged ? ' (the smallest are joined)' : ''))},
    level: {title: 'level of the leaf', ...counted(leaves.level, 'level in the octree')},
    visits: {title: 'visits to the leaf', ...counted(leaves.visits, 'visits')},
    state: {title: 'state of the leaf', leaf: i => STATES[leaves.state[i]],
            legend: () => swatches(Object.entries(STATES).filter(([name]) =>
              leaves.state.includes(name)), 'state')},
    angle: {title: 'smallest dihedral angle',
            ...measured('angle', 0, 60, '°', 'smallest dihedral angle of the cell')},
    ratio: {title: 'radius-edge ratio',
            ...measured('ratio', 2, 0.612, '', 'radius-edge ratio of the cell')},
    ...(view.radius_octaves ? {radius: {title: 'size', ...sized(view.radius_octaves)}} : {}),
    ...(view.sheets ? {sheet: {title: 'sheet', sheet: sheetColor, legend: sheetLegend}} : {}),
    ...(view.bodies && view.cells.length > 0 ? {body: {title: 'body',
      cell: (cells, i) => sheetColor(cells.body[i]),
      legend: () => note('Their names are below, where they can be hidden')}} : {}),
    plain: {title: 'none', legend: () => ''},
  };

  const css = c => `rgb(${c.join(',')})`;
  const escaped = text => text.replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);
  const note = text => `<p>${text}</p>`;
  const swatches = (items, label) => `<p>${label}</p><ul class="swatches">` + items.map(
    ([name, color]) => `<li><i style="background:${css(color)}"></i>${name}</li>`).join('') + '</ul>';
  const gradient = (stops, from, to, unit, label) => {
    const ticks = [0, 1, 2, 3, 4].map(i => from + (to - from) * i / 4);
    const text = v => Math.abs(v) >= 10 || v === 0 ? v.toFixed(0) : v.toFixed(2);
    return `<p>${label}</p><div class="gradient" style="background:linear-gradient(to right,` +
      `${stops.map(css).join(',')})"></div><div class="ticks">` +
      ticks.map(v => `<span>${text(v)}${unit}</span>`).join('') + '</div>' +
      '<div class="ticks"><span>bad</span><span>good</span></div>';
  };

  // The color of a cell: by its leaf, or by itself.
  function colorer(mode, cells) {
    const how = COLORS[mode];
    if (how.cell) return i => how.cell(cells, i);
    if (!how.leaf) return () => GRAY;
    const table = leaves.level.map((_, i) => how.leaf(i));
    return i => table[cells.leaf[i]];
  }

  // -- Shaders -----------------------------------------------------------------------------------

  // `position`: in w, which edges of the triangle are drawn (bits 0 to 2: opposite its
  // first, second and third vertex).
  const VERTEX = `#version 300 es
    precision highp float;
    in vec4 position;
    in vec3 color;
    uniform mat4 modelViewMatrix, projectionMatrix;
    out vec3 vColor, vEye, vEdge;
    centroid out vec3 vPlace;
    void main() {
      vColor = color;
      vPlace = position.xyz;
      vec4 eye = modelViewMatrix * vec4(position.xyz, 1.0);
      vEye = eye.xyz;
      int corner = gl_VertexID % 3, edges = int(position.w + 0.5);
      for (int i = 0; i < 3; ++i)  // the height over edge i; out of the way if it is not drawn
        vEdge[i] = (corner == i ? 1.0 : 0.0) + ((edges >> i & 1) == 1 ? 0.0 : 2.0);
      gl_Position = projectionMatrix * eye;
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    precision highp sampler3D;
    in vec3 vColor, vEye, vEdge;
    centroid in vec3 vPlace;       // inside the triangle also where a pixel's center is not
    uniform vec4 plane;            // what lies above it is cut away
    uniform bool isCut, hasEdges, isLit, isLookedUp;
    uniform sampler3D leafColors;  // by place, if isLookedUp
    uniform vec3 lookupOrigin, lookupSize;
    out vec4 result;
    void main() {
      if (isCut && dot(plane.xyz, vPlace) > plane.w) discard;
      vec3 base = isLookedUp ? texture(leafColors, (vPlace - lookupOrigin) / lookupSize).rgb : vColor;
      vec3 normal = normalize(cross(dFdx(vEye), dFdy(vEye)));
      float facing = abs(dot(normal, normalize(vEye)));
      float sky = 0.5 + 0.5 * normal.y * (gl_FrontFacing ? 1.0 : -1.0);
      float light = isLit ? 0.50 + 0.42 * facing + 0.10 * sky : 1.0;
      vec3 shown = base * light;
      if (hasEdges) {
        vec3 width = fwidth(vEdge);
        vec3 line = smoothstep(width * 0.2, width * 1.1, vEdge);
        float ink = 1.0 - min(min(line.x, line.y), line.z);
        float crowd = max(max(width.x, width.y), width.z);  // small triangles are edges all over
        shown = mix(shown, shown * 0.35, ink * (1.0 - smoothstep(0.07, 0.4, crowd)) * 0.8);
      }
      result = vec4(shown, 1.0);
    }`;

  // -- Scene -------------------------------------------------------------------------------------

  const $ = id => document.getElementById(id);
  const state = {
    axis: view.best_axis, offset: 0.5, isCut: true, isFlipped: false, isFlat: false,
    azimuth: 30, elevation: 20, color: view.default_color, edges: true, boxes: false,
    sites: true, creases: true,
    up: 'z',
    hidden: [],  // bodies, by id
  };
  const initial = {...state};
  let renderer, scene, camera, controls, uniforms, shell, cut, cap, boxes, sites, creases, lookup;
  let sets = [], whole = null, surface = null;
  const extent = view.extent.map(e => e || 1);  // in steps
  const middle = extent.map(e => e / 2);
  const diagonal = Math.hypot(...extent);

  const isCapped = () => !whole;

  // Outside, body 0, nothing is.
  const isShown = body => body > 0 && !state.hidden.includes(body);
  // For many: by id.
  const shownBodies = () => [0, ...(view.bodies || [''])].map((_, id) => isShown(id));

  function normal() {
    if (state.axis < 3) return [0, 1, 2].map(i => +(i === state.axis));
    const a = state.azimuth * Math.PI / 180, e = state.elevation * Math.PI / 180;
    return [Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e), Math.sin(e)];
  }

  // The plane n · p = d in steps; what is above it is cut away.
  function plane() {
    const n = normal();
    let low = 0, high = 0;
    for (let i = 0; i < 3; ++i) {
      low += Math.min(0, n[i] * extent[i]);
      high += Math.max(0, n[i] * extent[i]);
    }
    const stored = storedSet();
    const d = stored ? stored.at : low + state.offset * (high - low);
    return {n, d, low, high};
  }

  // At first a plane whose cells are in the page.
  function beginAtCells() {
    const near = sets.filter(s => s.axis === state.axis).map(s => s.at / extent[s.axis]).sort(
      (a, b) => Math.abs(a - 0.5) - Math.abs(b - 0.5))[0];
    initial.offset = state.offset = near === undefined ? 0.5 : near;
    initial.isFlat = state.isFlat = !whole || whole.count > 250000;
  }

  // The set of cells to show at the plane, if the page has one: it snaps to where that is.
  function storedSet() {
    if (whole || state.axis > 2) return null;
    const near = sets.filter(s => s.axis === state.axis).map(
      s => [Math.abs(s.at / extent[s.axis] - state.offset), s]).sort((a, b) => a[0] - b[0])[0];
    return near && near[0] < 0.02 ? near[1] : null;
  }

  function material(options, values) {
    return new THREE.RawShaderMaterial({
      vertexShader: VERTEX, fragmentShader: FRAGMENT, side: THREE.DoubleSide,
      uniforms: {
        plane: uniforms.plane, isCut: {value: false}, hasEdges: uniforms.hasEdges,
        isLit: {value: true}, isLookedUp: {value: false}, leafColors: uniforms.leafColors,
        lookupOrigin: uniforms.lookupOrigin, lookupSize: uniforms.lookupSize, ...values,
      }, ...options,
    });
  }

  function triangles(places, colors, how) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(places, 4));
    geometry.setAttribute('color', new THREE.BufferAttribute(colors, 4, true));
    geometry.setDrawRange(0, places.length / 4);
    const mesh = new THREE.Mesh(geometry, how);
    mesh.frustumCulled = false;
    return mesh;
  }

  const OPPOSITE = [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]];

  // What lies between two bodies is there once some are hidden.
  function shellOfCells(cells) {
    const shown = shownBodies(), isAll = state.hidden.length === 0;
    const isDrawn = (i, f) => (cells.boundary[i] >> f & 1) &&
      (isAll ? !(cells.boundary[i] >> f & 16) : shown[cells.body[i]]);
    let count = 0;
    for (let i = 0; i < cells.count; ++i)
      for (let f = 0; f < 4; ++f) if (isDrawn(i, f)) ++count;
    const places = new Uint16Array(12 * count), owner = new Uint32Array(count);
    const sheets = cells.sheets && new Uint32Array(count);
    let at = 0, facet = 0;
    for (let i = 0; i < cells.count; ++i)
      for (let f = 0; f < 4; ++f) {
        if (!(cells.boundary[i] >> f & 1)) continue;
        const sheet = cells.sheets ? cells.sheets[facet++] : 0;
        if (!isDrawn(i, f)) continue;
        if (sheets) sheets[at] = sheet;
        OPPOSITE[f].forEach((corner, k) => {
          const v = 3 * cells.corners[4 * i + corner], p = 12 * at + 4 * k;
          for (let axis = 0; axis < 3; ++axis) places[p + axis] = cells.positions[v + axis];
          places[p + 3] = 7;
        });
        owner[at++] = i;
      }
    const mesh = triangles(places, new Uint8Array(12 * count), material({}, {isCut: uniforms.isCut}));
    mesh.userData = {owner, cells, sheet: sheets};
    return mesh;
  }

  // What bounds the bodies that are shown, together.
  function partOfSurface({positions, corners, sheets}) {
    if (!view.bodies || !sheets) return {positions, corners, sheets};
    const shown = shownBodies();
    const isBorder = sheets.map(sheet => {
      const [behind, before] = sheet > 0 ? view.sheets.bodies[sheet - 1] : [0, 0];
      return shown[behind] !== shown[before];
    });
    return {positions, corners: corners.filter((_, i) => isBorder[Math.floor(i / 3)]),
            sheets: sheets.filter((_, i) => isBorder[i])};
  }

  function shellOfSurface({positions, corners, sheets}) {
    const places = new Uint16Array(4 * corners.length);
    for (let i = 0; i < corners.length; ++i) {
      for (let axis = 0; axis < 3; ++axis) places[4 * i + axis] = positions[3 * corners[i] + axis];
      places[4 * i + 3] = 7;
    }
    const mesh = triangles(places, new Uint8Array(4 * corners.length),
                           material({}, {isCut: uniforms.isCut, isLookedUp: {value: true},
                                         hasEdges: {value: false}}));
    mesh.userData = {sheet: sheets};
    return mesh;
  }

  function paint(colors, triangle, [r, g, b]) {
    for (let k = 12 * triangle; k < 12 * triangle + 12; k += 4) {
      colors[k] = r;
      colors[k + 1] = g;
      colors[k + 2] = b;
    }
  }

  function colorShell() {
    const {owner, cells, sheet} = shell.userData, ofSheet = COLORS[state.color].sheet;
    if (!owner) shell.material.uniforms.isLookedUp.value = !ofSheet;
    if (!owner && !ofSheet) return;
    const attribute = shell.geometry.attributes.color;
    const ofCell = ofSheet ? null : colorer(state.color, cells);
    for (let t = 0; 12 * t < attribute.array.length; ++t)
      paint(attribute.array, t, ofSheet ? ofSheet(sheet ? sheet[t] : 0) : ofCell(owner[t]));
    attribute.needsUpdate = true;
  }

  // Cells with corners on both sides, each with the heights of its corners over the plane.
  function forEachMet(cells, {n, d}, visit) {
    const h = [0, 0, 0, 0], {blocks, corners, positions} = cells;
    const shown = cells.body && state.hidden.length > 0 ? shownBodies() : null;
    for (let block = 0; 6 * block < blocks.length; ++block) {
      let low = -d, high = -d;
      for (let i = 0; i < 3; ++i) {
        const a = n[i] * blocks[6 * block + i], b = n[i] * blocks[6 * block + 3 + i];
        low += Math.min(a, b);
        high += Math.max(a, b);
      }
      if (low > 0 || high < 0) continue;
      const end = Math.min(cells.count, (block + 1) * BLOCK);
      for (let i = block * BLOCK; i < end; ++i) {
        if (shown && !shown[cells.body[i]]) continue;
        let below = false, above = false;
        for (let k = 0; k < 4; ++k) {
          const v = 3 * corners[4 * i + k];
          h[k] = n[0] * positions[v] + n[1] * positions[v + 1] + n[2] * positions[v + 2] - d;
          if (h[k] <= 0) below = true; else above = true;
        }
        if (below && above) visit(i, h);
      }
    }
  }

  class TriangleList {
    constructor(capacity) {
      this.places = new Float32Array(12 * capacity);
      this.colors = new Uint8Array(12 * capacity);
      this.count = 0;
    }
    add(corners, edges, color) {
      if (12 * (this.count + 1) > this.places.length) this.grow();
      let at = 12 * this.count;
      for (const [x, y, z] of corners) {
        this.places[at++] = x;
        this.places[at++] = y;
        this.places[at++] = z;
        this.places[at++] = edges;
      }
      paint(this.colors, this.count++, color);
    }
    grow() {
      for (const name of ['places', 'colors']) {
        const larger = new this[name].constructor(2 * this[name].length);
        larger.set(this[name]);
        this[name] = larger;
      }
    }
  }

  // The polygon in which the plane cuts a cell, as one or two triangles.
  function addSection(list, p, h, color) {
    const below = [], above = [];
    for (let k = 0; k < 4; ++k) (h[k] <= 0 ? below : above).push(k);
    const meet = (a, b) => {
      const t = h[a] / (h[a] - h[b]);
      return [0, 1, 2].map(i => p[a][i] + t * (p[b][i] - p[a][i]));
    };
    if (below.length === 2) {
      const [a, b] = below, [c, d] = above;
      const q = [meet(a, c), meet(a, d), meet(b, d), meet(b, c)];
      list.add([q[0], q[1], q[2]], 0b101, color);  // without the diagonal
      list.add([q[0], q[2], q[3]], 0b011, color);
    } else {
      const [one, others] = below.length === 1 ? [below[0], above] : [above[0], below];
      list.add(others.map(k => meet(one, k)), 7, color);
    }
  }

  function buildCut() {
    const at = plane(), cells = whole || storedSet();
    const list = new TriangleList(4096);
    let num = 0;
    if (state.isCut && cells) {
      const color = colorer(state.color, cells);
      const p = [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]];
      forEachMet(cells, at, (i, h) => {
        ++num;
        for (let k = 0; k < 4; ++k) {
          const v = 3 * cells.corners[4 * i + k];
          for (let axis = 0; axis < 3; ++axis) p[k][axis] = cells.positions[v + axis];
        }
        const c = color(i);
        if (state.isFlat) return addSection(list, p, h, c);
        for (const [a, b, d] of OPPOSITE) list.add([p[a], p[b], p[d]], 7, c);
      });
    }
    if (cut) {
      scene.remove(cut);
      cut.geometry.dispose();
    }
    cut = triangles(list.places.slice(0, 12 * list.count), list.colors.slice(0, 12 * list.count),
                    cutMaterial);
    place(cut);
    scene.add(cut);
    return num;
  }
  let cutMaterial;

  function place(object) {
    object.scale.setScalar(1 / diagonal);
    object.position.set(...middle.map(m => -m / diagonal));
    object.updateMatrix();
  }

  // Where the winding number of the kept part of the surface is not zero, seen along each ray: the
  // plane's points inside. Of several bodies, of which a side may be turned either way, where it is
  // odd. Drawn only where no stored cells are.
  function buildCap() {
    const count = (side, operation) => {
      const m = material({side, depthWrite: false, depthTest: false, colorWrite: false,
                          stencilWrite: true, stencilFunc: THREE.AlwaysStencilFunc},
                         {isCut: uniforms.isCut, hasEdges: {value: false}});
      m.stencilFail = m.stencilZFail = m.stencilZPass = operation;
      const mesh = new THREE.Mesh(shell.geometry, m);
      mesh.frustumCulled = false;
      place(mesh);
      return mesh;
    };
    const [more, less] = view.bodies ? [THREE.InvertStencilOp, THREE.InvertStencilOp] :
      [THREE.IncrementWrapStencilOp, THREE.DecrementWrapStencilOp];
    const back = count(THREE.BackSide, more), front = count(THREE.FrontSide, less);
    const face = material({stencilWrite: true, stencilFunc: THREE.NotEqualStencilFunc,
                           stencilRef: 0},
                          {isLookedUp: {value: true}, isLit: {value: false},
                           hasEdges: {value: false}});
    face.stencilFail = face.stencilZFail = face.stencilZPass = THREE.KeepStencilOp;
    const quad = triangles(new Float32Array(24), new Uint8Array(24), face);
    place(quad);
    back.renderOrder = front.renderOrder = 1;
    quad.renderOrder = 2;
    cap = {parts: [back, front, quad], quad};
    cap.parts.forEach(part => scene.add(part));
  }

  function moveCap({n, d}) {
    const m = middle, lift = d - (n[0] * m[0] + n[1] * m[1] + n[2] * m[2]);
    const center = m.map((v, i) => v + lift * n[i]);
    const any = Math.abs(n[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
    const unit = a => a.map(v => v / Math.hypot(...a));
    const u = unit(cross(n, any)), v = cross(n, u);
    const corner = (s, t) => center.map((c, i) => c + diagonal * (s * u[i] + t * v[i]));
    const q = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
    const places = cap.quad.geometry.attributes.position;
    [0, 1, 2, 0, 2, 3].forEach((k, i) => places.array.set([...q[k], 0], 4 * i));
    places.needsUpdate = true;
  }

  // The leaves' colors by place, for the surface and its cap: texels of the finest leaves, or of
  // 1/128 of the octree's side.
  function buildLookup() {
    const texel = Math.max(view.root_side / 128, view.root_side / 2 ** range(leaves.level)[1]);
    const low = [0, 1, 2].map(i => Math.floor((view.root_min[i] * -1 - texel) / texel));
    const size = [0, 1, 2].map(i => Math.ceil((extent[i] - view.root_min[i]) / texel) - low[i] + 2);
    const texture = new THREE.DataTexture3D(new Uint8Array(4 * size[0] * size[1] * size[2]), ...size);
    texture.format = THREE.RGBAFormat;
    texture.type = THREE.UnsignedByteType;
    texture.minFilter = texture.magFilter = THREE.NearestFilter;
    uniforms.leafColors.value = texture;
    uniforms.lookupOrigin.value.set(...[0, 1, 2].map(i => view.root_min[i] + low[i] * texel));
    uniforms.lookupSize.value.set(...size.map(s => s * texel));
    lookup = {texture, texel, low, size};
  }

  function colorLookup() {
    if (!lookup) return;
    const {texture, texel, low, size} = lookup, data = texture.image.data;
    for (let i = 0; i < data.length; i += 4) data.set(GRAY, i);
    const how = COLORS[state.color];
    for (let i = 0; how.leaf && i < leaves.level.length; ++i) {
      const color = how.leaf(i), side = view.root_side / 2 ** leaves.level[i];
      const span = [0, 1, 2].map(axis => {
        const first = leaves.place[axis][i] * side / texel - low[axis];
        const from = Math.round(first), to = Math.max(from + 1, Math.round(first + side / texel));
        return [Math.max(0, from), Math.min(size[axis], to)];
      });
      for (let z = span[2][0]; z < span[2][1]; ++z)
        for (let y = span[1][0]; y < span[1][1]; ++y)
          for (let x = span[0][0]; x < span[0][1]; ++x)
            data.set(color, 4 * ((z * size[1] + y) * size[0] + x));
    }
    texture.needsUpdate = true;
  }

  // Boxes of the leaves that the plane meets; without a cut, of all.
  function buildBoxes() {
    if (boxes) {
      scene.remove(boxes);
      boxes.geometry.dispose();
      boxes = null;
    }
    if (!state.boxes) return;
    const {n, d} = plane(), ends = [];
    for (let i = 0; i < leaves.level.length; ++i) {
      const side = view.root_side / 2 ** leaves.level[i];
      const low = [0, 1, 2].map(axis => view.root_min[axis] + side * leaves.place[axis][i]);
      let least = -d, most = -d;
      for (let axis = 0; axis < 3; ++axis) {
        least += n[axis] * low[axis] + Math.min(0, n[axis] * side);
        most += n[axis] * low[axis] + Math.max(0, n[axis] * side);
      }
      if (state.isCut && (least > 0 || most < 0)) continue;
      for (let axis = 0; axis < 3; ++axis)
        for (let corner = 0; corner < 4; ++corner) {
          const from = [...low], to = [...low];
          from[(axis + 1) % 3] = to[(axis + 1) % 3] += side * (corner & 1);
          from[(axis + 2) % 3] = to[(axis + 2) % 3] += side * (corner >> 1);
          to[axis] += side;
          ends.push(...from, ...to);
        }
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(ends), 3));
    boxes = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial(
      {color: 0x1b2a41, transparent: true, opacity: 0.55}));
    boxes.frustumCulled = false;
    boxes.renderOrder = 5;
    place(boxes);
    scene.add(boxes);
  }

  function buildSites() {
    const count = view.sites.length;
    if (!count) return;
    const geometry = new THREE.BufferGeometry();
    const at = new Float32Array(view.sites.flatMap(site => site.place));
    geometry.setAttribute('position', new THREE.BufferAttribute(at, 3));
    const disk = (size, color, order) => {
      const canvas = document.createElement('canvas');
      canvas.width = canvas.height = 32;
      const ink = canvas.getContext('2d');
      ink.arc(16, 16, 15, 0, 7);
      ink.fillStyle = color;
      ink.fill();
      const points = new THREE.Points(geometry, new THREE.PointsMaterial(
        {size: size * renderer.getPixelRatio(), sizeAttenuation: false, depthTest: false,
         map: new THREE.CanvasTexture(canvas), transparent: true}));
      points.frustumCulled = false;
      points.renderOrder = order;
      place(points);
      return points;
    };
    sites = new THREE.Group();
    sites.add(disk(11, '#ffffff', 8), disk(8, '#d6004b', 9));
    scene.add(sites);
  }

  // What is sharp on the surface: lines, which are drawn a little before it, and corners.
  async function buildCreases() {
    if (!view.creases) return;
    const {num_edges: count, num_vertices: all} = view.creases;
    const at = Float32Array.from(await positionsOf(view.creases));
    const ids = await sheetsOf(view.creases.ids);
    const before = program => {
      program.vertexShader = program.vertexShader.replace(
        '#include <project_vertex>',
        '#include <project_vertex>\ngl_Position.z -= 4e-4 * gl_Position.w;');
    };
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(at, 3));
    const lines = new THREE.LineSegments(
      geometry, new THREE.LineBasicMaterial({color: '#101418', onBeforeCompile: before}));
    const ends = new THREE.BufferGeometry();
    ends.setAttribute('position', new THREE.BufferAttribute(at, 3));
    const points = new THREE.Points(ends, new THREE.PointsMaterial(
      {color: '#101418', size: 5 * renderer.getPixelRatio(), sizeAttenuation: false,
       onBeforeCompile: before}));
    creases = new THREE.Group();
    for (const part of [lines, points]) {
      part.frustumCulled = false;
      part.renderOrder = 4;
      place(part);
      creases.add(part);
    }
    creases.userData = {at, ids, count, lines, points, numCorners: all - 2 * count};
    scene.add(creases);
  }

  // Those on the kept side.
  function showCreases(isKept) {
    creases.visible = state.creases;
    const {at, count, lines, points, numCorners} = creases.userData, edges = [], corners = [];
    const vertex = i => [at[3 * i], at[3 * i + 1], at[3 * i + 2]];
    for (let e = 0; e < count; ++e) {
      const [a, b] = [vertex(2 * e), vertex(2 * e + 1)];
      if (isKept(a.map((v, i) => (v + b[i]) / 2))) edges.push(2 * e, 2 * e + 1);
    }
    for (let i = 2 * count; i < 2 * count + numCorners; ++i)
      if (isKept(vertex(i))) corners.push(i);
    lines.geometry.setIndex(edges);
    points.geometry.setIndex(corners);
  }

  // The crease under the pointer, or the corner: within a few pixels, and before the model.
  function creaseAt(event) {
    if (!creases || !state.creases) return null;
    const {at, ids, count, lines, points} = creases.userData;
    const ray = rayAt(event), length = Math.sqrt(dot(ray.along, ray.along));
    const along = ray.along.map(v => v / length);
    const pixel = 2 * Math.tan(camera.fov * Math.PI / 360) / renderer.domElement.clientHeight;
    const vertex = i => [at[3 * i], at[3 * i + 1], at[3 * i + 2]];
    let best = null;
    const offer = (p, found) => {
      const way = minus(p, ray.from), depth = dot(way, along);
      if (depth <= 0) return;
      const off = Math.sqrt(Math.max(0, dot(way, way) - depth * depth)) / (pixel * depth);
      if (off < found.reach && (!best || off + found.handicap < best.off))
        best = {...found, depth, off: off + found.handicap};
    };
    const edges = lines.geometry.index ? lines.geometry.index.array : [];
    for (let k = 0; k < edges.length; k += 2) {
      const a = vertex(edges[k]), u = minus(vertex(edges[k + 1]), a), s = minus(ray.from, a);
      // The place of the segment that is closest to the ray.
      const uu = dot(u, u), uv = dot(u, along), det = uu - uv * uv;
      const t = det > 1e-12 * uu ? (dot(s, u) - dot(s, along) * uv) / det : 0;
      const part = Math.min(1, Math.max(0, t));
      offer(a.map((v, i) => v + part * u[i]),
            {crease: ids[edges[k] / 2], reach: 6, handicap: 3});
    }
    const corners = points.geometry.index ? points.geometry.index.array : [];
    for (const i of corners) offer(vertex(i), {corner: ids[i - count], reach: 7, handicap: 0});
    if (!best) return null;
    const at3 = plane(), sign = state.isFlipped ? -1 : 1;
    const [hit] = crossings(ray, p => !state.isCut || sign * (dot(at3.n, p) - at3.d) <= 0);
    return hit && hit.distance * length < best.depth - 8 * pixel * best.depth ? null : best;
  }

  function creaseText(found) {
    if (found.corner) return `corner ${found.corner}`;
    const name = view.creases.name[found.crease - 1], plain = `crease ${found.crease}`;
    return `${plain}${name === plain ? '' : `, ${name}`}: ` +
      `length ${view.creases.length[found.crease - 1].toPrecision(6)}`;
  }

  // -- Drawing -----------------------------------------------------------------------------------

  let isDrawn = false;
  function draw() {
    isDrawn = false;
    renderer.render(scene, camera);
    drawAxes();
  }
  function redraw() {
    if (!isDrawn) requestAnimationFrame(draw);
    isDrawn = true;
  }

  function drawAxes() {
    const colors = ['#b3261e', '#2e7d32', '#1f5fbf'];
    $('axes').innerHTML = AXES.map((name, i) => {
      const v = new THREE.Vector3().setComponent(i, 1).applyQuaternion(
        camera.quaternion.clone().inverse());
      return {z: v.z, text: `<line x1="0" y1="0" x2="${v.x * 24}" y2="${-v.y * 24}" ` +
        `stroke="${colors[i]}"/><text x="${v.x * 33}" y="${-v.y * 33 + 4}" ` +
        `style="fill:${colors[i]}">${name}</text>`};
    }).sort((a, b) => a.z - b.z).map(part => part.text).join('');
  }

  function update() {
    const at = plane();
    uniforms.isCut.value = state.isCut;
    const stored = storedSet();
    const sign = state.isFlipped ? -1 : 1;
    uniforms.plane.value.set(...at.n.map(v => sign * v), sign * at.d);
    const num = buildCut();
    if (cap) {
      moveCap(at);
      cap.parts.forEach(part => { part.visible = state.isCut && !stored; });
    }
    buildBoxes();
    if (sites) sites.visible = state.sites;
    if (creases) showCreases(p => !state.isCut || sign * (dot(at.n, p) - at.d) <= 0);
    uniforms.hasEdges.value = state.edges;
    showWhere(at, num, stored);
    redraw();
  }

  function recolor() {
    colorShell();
    colorLookup();
    $('legend').innerHTML = COLORS[state.color].legend();
    update();
  }

  const number = v => v.toLocaleString('en-US');
  function showWhere({n, d}, num, stored) {
    const world = d * view.step + n.reduce((sum, v, i) => sum + v * view.origin[i], 0);
    const value = Math.abs(world) < 1e-6 * diagonal * view.step ? '0' : world.toPrecision(4);
    const what = state.axis < 3 ? `${AXES[state.axis]} = ${value}` :
      `n·p = ${value}, n = (${n.map(v => v.toFixed(2)).join(', ')})`;
    const cells = whole || stored ? `${number(num)} cells meet the plane` :
      sets.length ? 'filled by leaf: no cells are in the page here' : 'filled by leaf';
    $('where').textContent = state.isCut ? `${what}: ${cells}` : 'not cut';
  }

  // -- What is where -----------------------------------------------------------------------------

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                           a[0] * b[1] - a[1] * b[0]];

  // The line of sight through a pixel, in steps.
  function rayAt(event) {
    const box = renderer.domElement.getBoundingClientRect();
    const far = new THREE.Vector3((event.clientX - box.left) / box.width * 2 - 1,
                                  1 - (event.clientY - box.top) / box.height * 2, 0.5);
    far.unproject(camera);
    const from = camera.position.toArray().map((v, i) => v * diagonal + middle[i]);
    return {from, along: minus(far.toArray().map((v, i) => v * diagonal + middle[i]), from)};
  }

  // Where the ray meets the kept part of the shell: distances, and which triangles.
  function crossings({from, along}, isKept) {
    const p = shell.geometry.attributes.position.array, found = [];
    const at = i => [p[i], p[i + 1], p[i + 2]];
    for (let t = 0; 12 * t < p.length; ++t) {
      const a = at(12 * t), u = minus(at(12 * t + 4), a), v = minus(at(12 * t + 8), a);
      const h = cross(along, v), det = dot(u, h);
      if (det === 0) continue;
      const s = minus(from, a), b = dot(s, h) / det;
      if (b < 0 || b > 1) continue;
      const q = cross(s, u), c = dot(along, q) / det;
      if (c < 0 || b + c > 1) continue;
      const distance = dot(v, q) / det;
      if (distance > 0 && isKept(from.map((f, i) => f + distance * along[i])))
        found.push({distance, triangle: t});
    }
    return found.sort((x, y) => x.distance - y.distance);
  }

  // The cell that a point lies in, of those that the plane meets.
  function cellAround(cells, point, at) {
    let found = -1;
    forEachMet(cells, at, i => {
      const c = [0, 1, 2, 3].map(k => {
        const v = 3 * cells.corners[4 * i + k];
        return [cells.positions[v], cells.positions[v + 1], cells.positions[v + 2]];
      });
      const inside = OPPOSITE.every(([a, b, d], k) => {
        const normal = cross(minus(c[b], c[a]), minus(c[d], c[a]));
        return dot(normal, minus(point, c[a])) * dot(normal, minus(c[k], c[a])) >= 0;
      });
      if (inside) found = i;
    });
    return found;
  }

  function leafAround(point) {
    return leaves.level.findIndex((level, i) => {
      const side = view.root_side / 2 ** level;
      return point.every((v, axis) => {
        const place = (v - view.root_min[axis]) / side - leaves.place[axis][i];
        return 0 <= place && place < 1;
      });
    });
  }

  // The leaf under the pointer, and the cell and the sheet if they are there: null beside the model.
  function pick(event) {
    const ray = rayAt(event), at = plane(), sign = state.isFlipped ? -1 : 1;
    const height = p => sign * (dot(at.n, p) - at.d);
    const hits = crossings(ray, p => !state.isCut || height(p) <= 0);
    const cells = whole || storedSet();
    const slope = dot(at.n, ray.along), distance = (at.d - dot(at.n, ray.from)) / slope;
    const isBefore = distance > 0 && (!hits.length || distance < hits[0].distance);
    if (state.isCut && slope !== 0 && isBefore) {
      const point = ray.from.map((f, i) => f + distance * ray.along[i]);
      const cell = cells ? cellAround(cells, point, at) : -1;
      if (cell >= 0) return {leaf: cells.leaf[cell], cell, cells};
      if (!whole && hits.length % 2 === 1) return {leaf: leafAround(point)};
    }
    if (!hits.length) return null;
    const {owner, sheet} = shell.userData, {triangle} = hits[0];
    const found = {sheet: sheet ? sheet[triangle] : 0};
    if (owner) {
      const cell = owner[triangle];
      return {...found, leaf: whole.leaf[cell], cell, cells: whole};
    }
    return {...found,
            leaf: leafAround(ray.from.map((f, i) => f + hits[0].distance * ray.along[i]))};
  }

  function tell(event) {
    const found = pick(event), box = $('picked'), crease = creaseAt(event);
    if (crease) {
      box.hidden = false;
      box.textContent = creaseText(crease);
      return;
    }
    box.hidden = !found || found.leaf < 0;
    if (box.hidden) return;
    const {leaf, cell, cells, sheet} = found;
    const quality = name => (cells[name][cell] / 255 * (view.quality[name][1] -
      view.quality[name][0]) + view.quality[name][0]);
    const named = sheet ? `sheet ${sheet}, ${view.sheets.name[sheet - 1]}: area ` +
      `${view.sheets.area[sheet - 1].toPrecision(6)}\n` : '';
    const body = cells && cells.body ? `body ${cells.body[cell]}, ` +
      `${view.bodies[cells.body[cell] - 1]}\n` : '';
    box.textContent = `${body}${named}leaf ${leaves.key[leaf]}, level ${leaves.level[leaf]}: ` +
      `${number(leaves.cells[leaf])} cells, ${leaves.visits[leaf]} visits` +
      (cells ? `\ncell: smallest angle ${quality('angle').toFixed(1)}°, ` +
        `radius-edge ratio ${quality('ratio').toFixed(2)}` : '');
  }

  // -- Controls ----------------------------------------------------------------------------------

  function standUp() {
    const up = new THREE.Vector3().setComponent(AXES.indexOf(state.up), 1);
    camera.up.copy(up);
    if (controls) controls.dispose();
    controls = new THREE.OrbitControls(camera, renderer.domElement);
    controls.screenSpacePanning = true;
    controls.enableKeys = false;
    controls.addEventListener('change', redraw);
  }

  // From the side that the plane cuts away, a little from above and aside, so that all is seen.
  function resetCamera() {
    const up = AXES.indexOf(state.up), right = (up + 1) % 3, deep = (up + 2) % 3;
    const direction = new THREE.Vector3(...normal().map(v => state.isFlipped ? -v : v));
    const lean = (axis, by) => direction.setComponent(axis, direction.getComponent(axis) + by);
    if (state.axis === up) {
      lean(deep, -0.55);
      lean(right, 0.2);
    } else {
      lean(up, 0.35);
      lean(state.axis === right ? deep : right, state.axis === right ? -0.35 : 0.35);
    }
    direction.normalize();
    controls.target.set(0, 0, 0);
    camera.position.copy(direction).multiplyScalar(distanceToFit(direction));
    controls.update();
  }

  // Where a camera that looks along -direction sees all of the model, by some thousand vertices.
  function distanceToFit(direction) {
    const side = new THREE.Vector3().crossVectors(camera.up, direction).normalize();
    const above = new THREE.Vector3().crossVectors(direction, side);
    const high = Math.tan(camera.fov * Math.PI / 360), wide = high * camera.aspect;
    const places = shell.geometry.attributes.position.array, p = new THREE.Vector3();
    const stride = 4 * Math.ceil(places.length / 4 / 5000);
    let distance = 0;
    for (let at = 0; at < places.length; at += stride) {
      p.set(...middle.map((m, i) => (places[at + i] - m) / diagonal));
      distance = Math.max(distance, p.dot(direction) + Math.abs(p.dot(side)) / wide,
                          p.dot(direction) + Math.abs(p.dot(above)) / high);
    }
    return 1.05 * distance;
  }

  function resize() {
    const box = renderer.domElement.parentElement.getBoundingClientRect();
    renderer.setSize(box.width, box.height, false);
    camera.aspect = box.width / box.height;
    camera.updateProjectionMatrix();
    redraw();
  }

  function showState() {
    document.querySelectorAll('[name=axis]').forEach(input => {
      input.checked = +input.value === state.axis;
    });
    $('free').hidden = state.axis !== 3;
    for (const id of ['offset', 'azimuth', 'elevation', 'color', 'up']) $(id).value = state[id];
    for (const id of ['isCut', 'isFlipped', 'isFlat', 'edges', 'boxes', 'sites', 'creases'])
      $(id).checked = state[id];
    document.querySelectorAll('#bodies input').forEach(input => {
      input.checked = isShown(+input.value);
    });
    showStations();
  }

  // Marks under the slider where cells are in the page.
  function showStations() {
    const here = sets.filter(s => s.axis === state.axis);
    $('stations').innerHTML = here.map(
      s => `<option value="${s.at / extent[s.axis]}"></option>`).join('');
    $('jump').hidden = here.length === 0;
  }

  function set(change) {
    const before = {...state};
    Object.assign(state, change);
    showState();
    if (state.up !== before.up) {
      standUp();
      resetCamera();
    }
    if (String(state.hidden) !== String(before.hidden)) rebuildShell();
    else if (state.color !== before.color) recolor();
    else update();
  }

  // Other bodies are shown.
  function rebuildShell() {
    scene.remove(shell);
    shell.geometry.dispose();
    shell = whole ? shellOfCells(whole) : shellOfSurface(partOfSurface(surface));
    place(shell);
    scene.add(shell);
    if (cap) {
      scene.remove(...cap.parts);
      buildCap();
    }
    recolor();
  }

  function jump(step) {
    const at = sets.filter(s => s.axis === state.axis).map(s => s.at / extent[s.axis])
      .sort((a, b) => a - b);
    const next = step > 0 ? at.find(v => v > state.offset + 0.021) :
      at.reverse().find(v => v < state.offset - 0.021);
    if (next !== undefined) set({offset: next});
  }

  function reset() {
    const isAll = state.hidden.length === 0;
    Object.assign(state, initial);
    if (!isAll) rebuildShell();
    standUp();
    resetCamera();
    showState();
    recolor();
  }

  function lookAlong(axis, sign) {
    const distance = camera.position.distanceTo(controls.target);
    const direction = new THREE.Vector3().setComponent(axis, sign);
    if (AXES[axis] === state.up) direction.setComponent((axis + 2) % 3, -0.001);
    camera.position.copy(controls.target).addScaledVector(direction.normalize(), distance);
    controls.update();
    redraw();
  }

  function cutFromView() {
    const n = camera.position.clone().sub(controls.target).normalize();
    set({axis: 3, isFlipped: false, elevation: Math.round(Math.asin(n.z) * 180 / Math.PI),
         azimuth: Math.round(Math.atan2(n.y, n.x) * 180 / Math.PI)});
  }

  function press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target instanceof HTMLSelectElement) return;
    const actions = {
      r: reset, c: () => set({isCut: !state.isCut}), f: () => set({isFlat: !state.isFlat}),
      e: () => set({edges: !state.edges}), b: () => set({boxes: !state.boxes}),
      s: () => set({sites: !state.sites}), k: () => set({creases: !state.creases}), v: cutFromView,
      u: () => set({up: AXES[(AXES.indexOf(state.up) + 1) % 3]}),
      x: () => set({axis: 0}), y: () => set({axis: 1}), z: () => set({axis: 2}),
      1: () => lookAlong(0, 1), 2: () => lookAlong(1, -1), 3: () => lookAlong(2, 1),
      '+': () => set({offset: Math.min(1, state.offset + 0.01)}),
      '-': () => set({offset: Math.max(0, state.offset - 0.01)}),
    };
    const action = actions[event.key];
    if (action) action();
  }

  function connect() {
    document.querySelectorAll('[name=axis]').forEach(input => {
      input.addEventListener('change', () => set({axis: +input.value}));
    });
    for (const id of ['offset', 'azimuth', 'elevation'])
      $(id).addEventListener('input', () => set({[id]: +$(id).value}));
    for (const id of ['color', 'up']) $(id).addEventListener('change', () => set({[id]: $(id).value}));
    for (const id of ['isCut', 'isFlipped', 'isFlat', 'edges', 'boxes', 'sites', 'creases'])
      $(id).addEventListener('change', () => set({[id]: $(id).checked}));
    $('bodies').addEventListener('change', event => {
      const body = +event.target.value, others = state.hidden.filter(id => id !== body);
      set({hidden: event.target.checked ? others : [...others, body].sort((a, b) => a - b)});
    });
    $('allBodies').addEventListener('click', () => set({hidden: []}));
    $('noBodies').addEventListener('click', () => set({hidden: view.bodies.map((_, i) => i + 1)}));
    $('reset').addEventListener('click', reset);
    $('fromView').addEventListener('click', cutFromView);
    $('before').addEventListener('click', () => jump(-1));
    $('after').addEventListener('click', () => jump(1));
    document.addEventListener('keydown', press);
    let down = null, isWaiting = false;
    // Sheets and creases tell their names as the pointer moves over them.
    renderer.domElement.addEventListener('pointermove', event => {
      const hasSheets = COLORS[state.color].sheet, hasCreases = creases && state.creases;
      if (!(hasSheets || hasCreases) || event.buttons || isWaiting) return;
      isWaiting = true;
      requestAnimationFrame(() => {
        isWaiting = false;
        if (hasSheets || creaseAt(event)) tell(event);
      });
    });
    renderer.domElement.addEventListener('pointerdown', event => { down = event; });
    renderer.domElement.addEventListener('pointerup', event => {
      if (!down) return;
      const moved = Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY);
      if (moved < 4) tell(event);
    });
    new ResizeObserver(resize).observe(renderer.domElement.parentElement);
  }

  function offerColors() {
    const hasCells = view.cells.length > 0;
    const names = Object.keys(COLORS).filter(name => hasCells || !COLORS[name].cell)
      .filter(name => !view.is_done || name !== 'state');
    $('color').innerHTML = names.map(
      name => `<option value="${name}">${COLORS[name].title}</option>`).join('');
  }

  function offerBodies() {
    $('ofBodies').hidden = !view.bodies;
    if (!view.bodies) return;
    $('bodies').innerHTML = view.bodies.map((name, i) =>
      `<label class="check"><input type="checkbox" value="${i + 1}"> <i style="background:` +
      `${css(sheetColor(i + 1))}"></i>${escaped(name)}</label>`).join('');
  }

  async function start() {
    const canvas = $('canvas');
    const context = canvas.getContext('webgl2', {antialias: true, stencil: true});
    if (!context) throw new Error('this browser gives no WebGL 2');
    renderer = new THREE.WebGLRenderer({canvas, context, antialias: true});
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    renderer.setClearColor(0xf4f6f9);
    scene = new THREE.Scene();
    camera = new THREE.PerspectiveCamera(28, 1, 0.01, 20);
    uniforms = {plane: {value: new THREE.Vector4()}, isCut: {value: true}, hasEdges: {value: true},
                leafColors: {value: null}, lookupOrigin: {value: new THREE.Vector3()},
                lookupSize: {value: new THREE.Vector3(1, 1, 1)}};
    buildLookup();
    cutMaterial = material({}, {});
    for (const cells of view.cells) sets.push(await loadCells(cells));
    if (sets.length === 1 && sets[0].axis < 0) [whole] = sets.splice(0, 1);
    if (whole) {
      shell = shellOfCells(whole);
    } else {
      surface = {positions: await positionsOf(view.surface),
                 corners: await indicesOf(view.surface.triangles, view.surface.num_triangles, 3),
                 sheets: view.surface.sheets && await sheetsOf(view.surface.sheets)};
      shell = shellOfSurface(partOfSurface(surface));
    }
    place(shell);
    scene.add(shell);
    if (isCapped()) buildCap();
    beginAtCells();
    buildSites();
    await buildCreases();
    if (!creases) $('creases').parentElement.style.display = 'none';
    offerColors();
    offerBodies();
    standUp();
    resize();
    resetCamera();
    connect();
    showState();
    recolor();
    draw();
    document.body.classList.add('is-ready');
  }

  // For tests and for the console of the browser.
  window.locvolReport = {
    state, set, reset,
    ready: start().then(() => true, error => {
      $('viewer').classList.add('is-failed');
      $('failure').textContent = `The interactive view cannot be shown: ${error.message}. ` +
        'The sections and figures below need nothing but this page.';
      throw error;
    }),
    turn(azimuth) {
      camera.position.applyAxisAngle(camera.up, azimuth);
      controls.update();
      draw();
    },
    picture() {
      draw();
      return renderer.domElement.toDataURL('image/png');
    },
    triangles: () => ({shell: shell.geometry.drawRange.count / 3,
                       cut: cut.geometry.drawRange.count / 3}),
  };
  window.locvolReport.ready.catch(() => {});
})();
