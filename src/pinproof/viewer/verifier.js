// Verifies a proof file again, as pinproof/verifier does in Python: everything that it claims is derived from its numbers.
// It shares no code with what makes proofs or checks poses. docs/formats/proof.md describes the file, and
// pinproof/verifier/interval_bounds.py derives the bounds. Only + - * / and the square root of IEEE 754 are assumed.
// The constraints of the tcp that a proof may have are left to Python.
const ProofVerifier = (() => {
  class Refused extends Error {}
  /** @param {string} where @param {string} why @returns {never} */
  const refuse = (where, why) => { throw new Refused(where + ": " + why); };

  // --- numbers: v, and a bound e of its distance from the exact number ---
  /** @typedef {{v: number, e: number}} Near @typedef {Near[]} Vector @typedef {Record<string, any>} Row */
  const ROUNDOFF = 2 ** -53, UNIT_ERROR = 8 * ROUNDOFF, ROTATION_ERROR = 16 * ROUNDOFF, TINY = 2 ** -500, AXES = [0, 1, 2];
  const UP = 1 + 2 ** -40;  // covers the rounding of bounds, which are sums and products of up to 4,096 numbers >= 0
  const near = (v, e = 0) => ({ v, e }), exact = (values) => values.map((v) => near(v));
  const rounded = (v, e) => ({ v, e: UP * (e + ROUNDOFF * Math.abs(v) + TINY) });
  const add = (a, b) => rounded(a.v + b.v, a.e + b.e), negative = (a) => near(-a.v, a.e);
  const times = (a, b) => rounded(a.v * b.v, Math.abs(a.v) * b.e + Math.abs(b.v) * a.e + a.e * b.e);
  const above = (x) => x + Math.abs(x) * 2 ** -50 + TINY, below = (x) => -above(-x);
  const upper = (a) => above(a.v + a.e), lower = (a) => below(a.v - a.e);
  const plus = (a, b) => a.map((x, k) => add(x, b[k])), minus = (a, b) => plus(a, reversed(b));
  const scaled = (s, a) => a.map((x) => times(s, x)), reversed = (a) => a.map(negative);
  const dot = (a, b) => add(add(times(a[0], b[0]), times(a[1], b[1])), times(a[2], b[2]));
  const cross = (a, b) => [[1, 2], [2, 0], [0, 1]].map(([i, j]) => add(times(a[i], b[j]), negative(times(a[j], b[i]))));
  const longest = (a) => UP * Math.sqrt(a.reduce((sum, x) => sum + (Math.abs(x.v) + x.e) ** 2, TINY));  // above the length
  const transposed = (m) => AXES.map((k) => m.map((row) => row[k])), turned = (m, v) => m.map((row) => dot(row, v));
  const product = (a, b) => a.map((row) => transposed(b).map((column) => dot(row, column)));
  const ZERO = exact([0, 0, 0]), ROOT = { rotation: AXES.map((k) => exact(AXES.map((c) => Number(c === k)))), translation: ZERO };

  /** Sine and cosine, by reduction to [-pi/4, pi/4] with a pi/2 in three parts, and Taylor polynomials. */
  function sineCosine(angle) {
    const x = angle.v, turns = Math.round(x * (2 / Math.PI));
    const r = ((x - turns * 1.5707963267341256) - turns * 6.077100506303966e-11) - turns * 2.0222662487959506e-21, z = r * r;
    let sine = 1, cosine = 1;
    for (let n = 16; n > 0; n -= 2) {
      sine = 1 - sine * z / (n * (n + 1));
      cosine = 1 - cosine * z / (n * (n - 1));
    }
    sine *= r;
    const e = Math.abs(turns) < 2 ** 20 ? UP * (angle.e + UNIT_ERROR) : 2, quarter = ((turns % 4) + 4) % 4;
    return ([[sine, cosine], [cosine, -sine], [-sine, -cosine], [-cosine, sine]][quarter] ?? [NaN, NaN]).map((v) => near(v, e));
  }
  /** The rotation about an axis, by Rodrigues' formula. */
  function about(axis, angle) {
    const [s, c] = sineCosine(angle), rest = add(near(1), negative(c)), along = axis.map((x) => times(s, x));
    return AXES.map((i) => AXES.map((j) => {
      const both = times(times(rest, axis[i]), axis[j]);
      return i === j ? add(both, c) : add(both, (j - i + 3) % 3 === 1 ? negative(along[3 - i - j]) : along[3 - i - j]);
    }));
  }

  // --- values of the file ---
  const isRow = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
  const isText = (value) => typeof value === "string" && /^(?:[^\p{C}\p{Z}]| )+$/u.test(value);
  const place = (where, key) => where ? where + "." + key : key;
  function member(row, where, key) {
    if (!isRow(row)) refuse(where || "proof", "must be a mapping");
    return Object.hasOwn(row, key) ? row[key] : refuse(place(where, key), "is missing");
  }
  /** The mapping of a key, without unknown fields; their meaning is not known. */
  function checkFields(row, where, known) {
    const other = isRow(row) ? Object.keys(row).find((key) => !known.split(" ").includes(key)) : undefined;
    if (other !== undefined) refuse(where || "proof", "unknown field " + JSON.stringify(other).slice(0, 80));
  }
  const list = (row, where, key) => Array.isArray(member(row, where, key)) ? row[key] : refuse(place(where, key), "must be a list");
  const text = (row, where, key) => isText(member(row, where, key)) ? row[key] : refuse(place(where, key), "must be a printable text");
  const index = (value, low, end, where) => Number.isInteger(value) && !Object.is(value, -0) && value >= low && value < end ? value
    : refuse(where, `must be an index from ${low} to below ${end}`);
  /** Numbers in nested lists of these lengths; null is any length, that of the first list. */
  function numbers(row, where, key, shape, largest = 1e6) {
    const sizes = [...shape], at = place(where, key), visit = (value, depth) => {
      if (depth === sizes.length) return (typeof value === "number" && Math.abs(value) <= largest) || refuse(at, "must be finite numbers up to " + largest);
      if (!Array.isArray(value)) refuse(at, "must be nested lists of numbers");
      if (value.length !== (sizes[depth] ??= value.length)) refuse(at, `must have ${sizes[depth]} entries`);
      for (const part of value) visit(part, depth + 1);
    };
    visit(member(row, where, key), 0);
    return row[key];
  }
  const optional = (row, where, key, count, missing) => {
    const known = list(row, where, key).map((value) => value ?? 0);
    return numbers({ [key]: known }, where, key, [count]).map((v, k) => row[key][k] === null ? missing : v);
  };
  const names = (row, where, key) => list(row, where, key).map((each, k) => Array.isArray(each) && each.length === 3
    && isText(each[0]) && isText(each[1]) && each[0] !== each[1] ? each : refuse(`${place(where, key)}[${k}]`, "must be two different names and a third entry"));
  function unitVector(row, where, key) {
    const v = numbers(row, where, key, [3]), length = Math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    return Math.abs(length - 1) <= 1e-9 ? v.map((x) => near(x / length, UNIT_ERROR)) : refuse(place(where, key), "its length must be 1");
  }
  /** Rotation and translation; the nearest rotation is meant, to which one Newton step leads. */
  function placement(row, where) {
    const m = numbers(row, where, "placement", [3, 4]), sum = (f) => f(0) + f(1) + f(2), square = AXES.map((i) => AXES.map((j) => sum((k) => m[k][i] * m[k][j])));
    const det = sum((k) => m[0][k] * (m[1][(k + 1) % 3] * m[2][(k + 2) % 3] - m[1][(k + 2) % 3] * m[2][(k + 1) % 3]));
    if (!square.every((r, i) => r.every((x, j) => Math.abs(x - Number(i === j)) <= 1e-9)) || !(det > 0)) refuse(place(where, "placement"), "is not rigid");
    const rotation = AXES.map((i) => AXES.map((j) => near(sum((k) => m[i][k] * ((k === j ? 1.5 : 0) - 0.5 * square[k][j])), ROTATION_ERROR)));
    return { rotation, translation: exact(m.map((r) => r[3])) };
  }
  /** SHA-256 of texts and of numbers as doubles. */
  async function digest(...parts) {
    const bytes = parts.map((part) => typeof part === "string" ? part : Float64Array.from([part].flat(Infinity).map(Number)));
    const hash = await crypto.subtle.digest("SHA-256", await new Blob(bytes).arrayBuffer());
    return [...new Uint8Array(hash)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  }

  // --- bodies ---
  /** A hull of points, each with a disc about z, grown by a ball and an ellipsoid; and a ball around it. */
  function hull(points, discs, radius = 0, semi = [0, 0, 0]) {
    const ends = AXES.map((k) => points.reduce(([low, high], p) => [Math.min(low, p[k]), Math.max(high, p[k])], [Infinity, -Infinity]));
    const centre = ends.map(([low, high]) => (low + high) / 2), length = (x, y, z = 0) => Math.sqrt(x * x + y * y + z * z);
    const far = points.reduce((most, p, k) => Math.max(most, length(length(p[0] - centre[0], p[1] - centre[1]) + discs[k], p[2] - centre[2])), 0);
    const ball = UP * (far + radius + Math.max(...semi)) + TINY, extent = UP * (length(...centre) + 2 * ball);
    return { points: Float64Array.from(points.flat()), discs: discs.some(Boolean) && discs, radius, semi: semi.some(Boolean) && semi, ends, centre, ball, extent };
  }
  /** The largest d . x of a body. */
  function support({ points, discs, radius, semi }, x, y, z) {
    const flat = Math.sqrt(x * x + y * y);
    let most = -Infinity;
    for (let k = 0; k < points.length; k += 3) {
      const along = points[k] * x + points[k + 1] * y + points[k + 2] * z + (discs ? flat * discs[k / 3] : 0);
      if (!(along <= most)) most = along;  // also for NaN
    }
    if (radius) most += radius * Math.sqrt(x * x + y * y + z * z);
    return semi ? most + Math.sqrt((semi[0] * x) ** 2 + (semi[1] * y) ** 2 + (semi[2] * z) ** 2) : most;
  }
  async function readBody(row, i, joints) {
    const where = `bodies[${i}]`, at = where + ".shape";
    checkFields(row, where, "name owner kind geometry level source mesh_sha256 joint placement shape sha256");
    const [name, owner, geometry, kind, sha256] = ["name", "owner", "geometry", "kind", "sha256"].map((key) => text(row, where, key));
    if (!["link", "attached", "obstacle"].includes(kind)) refuse(where + ".kind", "must be link, attached or obstacle");
    const level = index(member(row, where, "level"), 0, 3, where + ".level"), joint = index(member(row, where, "joint"), -1, joints, where + ".joint");
    if (kind === "obstacle" && joint !== -1) refuse(where + ".joint", "an obstacle moves with no joint");
    const placed = placement(row, where), shape = member(row, where, "shape"), halfSpace = shape === "half_space";
    if (halfSpace && kind !== "obstacle") refuse(at, "only an obstacle can be a half-space");
    const body = { where, name, owner, geometry, kind, level, joint, ...placed, halfSpace, bounded: shape !== null && !halfSpace, triangles: null,
      vertices: [], solid: false, ...hull([[0, 0, 0]], [0]) };
    let parts = /** @type {any[]} */ ([]);
    if (isRow(shape) && Object.hasOwn(shape, "triangles")) {
      checkFields(shape, at, "vertices triangles solid");
      const vertices = numbers(shape, at, "vertices", [null, 3]), triangles = numbers(shape, at, "triangles", [null, 3], 1e12), solid = member(shape, at, "solid");
      if (!vertices.length || !triangles.length || !triangles.flat().every((v) => Number.isInteger(v) && v >= 0 && v < vertices.length))
        refuse(at + ".triangles", "must be indices of vertices");
      if (typeof solid !== "boolean") refuse(at + ".solid", "must be true or false");
      Object.assign(body, hull(vertices, vertices.map(() => 0)), { triangles, vertices, solid });
      // A point gets outside through triangles only, if each edge between two points occurs equally often in both directions.
      const keys = vertices.map((v) => v.join()), edges = new Map();  // -0 and 0 are one text
      if (solid) for (const [a, b] of triangles.flatMap((t) => AXES.map((k) => [keys[t[k]], keys[t[(k + 1) % 3]]]))) {
        const key = a < b ? a + " " + b : b + " " + a;
        edges.set(key, (edges.get(key) ?? 0) + Number(a < b) - Number(a > b));
      }
      if ([...edges.values()].some(Boolean)) refuse(at + ".solid", "the triangles do not enclose a volume");
      parts = [vertices, triangles, solid];
    } else if (body.bounded) {
      checkFields(shape, at, "points disc_radii radius semi_axes");
      const points = numbers(shape, at, "points", [null, 3]), discs = numbers(shape, at, "disc_radii", [points.length]);
      const semi = numbers(shape, at, "semi_axes", [3]), radius = numbers(shape, at, "radius", []);
      if (!points.length || ![radius, ...semi, ...discs].every((r) => r >= 0)) refuse(at, "must have points, and no radius below 0");
      Object.assign(body, hull(points, discs, radius, semi));
      parts = [points, discs, radius, semi];
    }
    if (sha256 !== await digest(joint, row.placement, ...parts, halfSpace ? shape : "")) refuse(where + ".sha256", "does not match the joint, placement and shape in the file");
    return body;
  }
  /** The convex body around a range of the triangles of a mesh: their corners, or the box around many. */
  function partOf(mesh, first, end) {
    let points = mesh.triangles.slice(first, end).flat().map((v) => mesh.vertices[v]);
    const { ends } = hull(points, points.map(() => 0));
    if (end - first > 64) points = Array.from({ length: 8 }, (_, k) => AXES.map((axis) => ends[axis][(k >> axis) & 1]));
    return { ...mesh, ...hull(points, points.map(() => 0)), triangles: null };
  }
  /** A point of each connected part of a body. */
  function witnesses(body) {
    if (!body.triangles) return body.halfSpace ? [] : [[...body.points.slice(0, 3)]];
    const parent = body.vertices.map((_, k) => k), rootOf = (k) => { while (parent[k] !== k) k = parent[k] = parent[parent[k]]; return k; };
    for (const [a, b, c] of body.triangles) for (const other of [b, c]) parent[rootOf(a)] = rootOf(other);
    return [...new Set(body.triangles.map(([a]) => rootOf(a)))].map((k) => body.vertices[/** @type {number} */ (k)]);
  }
  /** Above how often a mesh winds about a point: solid angles (A. van Oosterom, J. Strackee, 1983, equation 8). */
  function winding(mesh, point, error) {
    const inner = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2], length = (a) => Math.sqrt(inner(a, a));
    if (length(AXES.map((k) => point[k] - mesh.centre[k])) * (1 - UNIT_ERROR) > mesh.ball + error) return 0;
    let sum = 0, off = 0;
    for (const t of mesh.triangles) {
      const [a, b, c] = t.map((v) => AXES.map((k) => mesh.vertices[v][k] - point[k])), [la, lb, lc] = [a, b, c].map(length);
      const across = la * lb * lc + inner(a, b) * lc + inner(b, c) * la + inner(c, a) * lb;
      const volume = inner(a, AXES.map((k) => b[(k + 1) % 3] * c[(k + 2) % 3] - b[(k + 2) % 3] * c[(k + 1) % 3]));
      const half = Math.atan2(volume, across), [sine, cosine] = sineCosine(near(half)), size = Math.sqrt(volume * volume + across * across);
      // Five products of three lengths change with their factors, and have less than 20 roundings each.
      const larger = (la + error) * (lb + error) * (lc + error);
      const wrong = 5 * (larger - la * lb * lc + 32 * ROUNDOFF * larger) + 3 * size * sine.e + Math.abs(volume * cosine.v - across * sine.v);
      off += wrong < size / 2 && across * cosine.v + volume * sine.v > 0 ? wrong / size : Infinity;
      sum += half;
    }
    return Math.abs(sum / (2 * Math.PI)) + off / 2;
  }

  // --- the curve ---
  async function readCurve(row) {
    checkFields(row, "curve", "joint_names knots control");
    const joints = list(row, "curve", "joint_names"), dof = joints.length, knots = numbers(row, "curve", "knots", [null], 1e12);
    if (!dof || !joints.every(isText) || new Set(joints).size !== dof) refuse("curve.joint_names", "must be different printable names");
    if (knots.length < 2) refuse("curve.knots", "must be two or more");
    const control = numbers(row, "curve", "control", [knots.length - 1, null, dof]), degree = control[0].length - 1, columns = [...joints.keys()];
    if (degree < 0) refuse("curve.control", "must have one control point or more in each piece");
    // Knots increase, no piece is too narrow for its motion, and pieces join.
    const width = control.map((_, k) => knots[k + 1] - knots[k]), range = (points) => Math.max(...points) - Math.min(...points);
    const span = control.map((piece) => Math.max(...columns.map((j) => range(piece.map((p) => p[j]))))), single = width.length === 1 && width[0] === 0 && span[0] === 0;
    const jumps = control.slice(1).map((piece, k) => Math.max(...columns.map((j) => Math.abs(piece[0][j] - control[k][degree][j]))));
    width.forEach((w, k) => w > 0 || single || refuse(`curve.knots[${k + 1}]`, "must be larger than the knot before it"));
    width.forEach((w, k) => span[k] <= 1e6 * w || refuse(`curve.knots[${k + 1}]`, "the piece is too narrow for its motion"));
    jumps.forEach((jump, k) => jump <= 1e-12 || refuse(`curve.control[${k}]`, "the next piece does not begin where this one ends"));
    // The hash has the text of Python's tuple of names and shape.
    const quote = (name) => { const q = name.includes("'") && !name.includes('"') ? '"' : "'"; return q + name.replaceAll("\\", "\\\\").replaceAll(q, "\\" + q) + q; };
    const sha256 = await digest(`((${joints.map(quote).join(", ")}${dof === 1 ? "," : ""}), (${control.length}, ${degree + 1}, ${dof}))`, knots, control);
    const size = control.flat(2).reduce((most, x) => Math.max(most, Math.abs(x)), 0);
    return { joints, dof, knots, control, degree, columns, width, single, size, jump: UP * jumps.reduce((a, b) => Math.max(a, b), 0), low: knots[0], high: knots[knots.length - 1], sha256 };
  }
  /** The quantities with limits. Each piece is in the hull of its control points, or its halves are (see parts.py). */
  function checkLimits({ columns, width, control, single }, limits) {
    const rows = (f) => width.map((w, k) => columns.map((j) => f(j, k, w))), found = /** @type {string[]} */ ([]), BISECTIONS = 60;
    const most = (points, j) => points.reduce((m, p) => Math.max(m, Math.abs(p[j])), 0), sizes = columns.map((j) => control.reduce((m, piece) => Math.max(m, most(piece, j)), 0));
    // The errors of the control points, which were rounded several times, and those of this computation
    let size = rows((j) => 2 ** -49 * sizes[j]), own = rows(() => 0);
    for (const [order, [quantity, low, high]] of limits.entries()) {
      const no = (k) => refuse(`curve.control[${k}]`, `the ${quantity} is not proven to keep the limits of the proof`), last = control[0].length - 1;
      const jumps = rows((j, k) => order === 2 && k && isFinite(high[j]) ? Math.abs(control[k][0][j] - control[k - 1][last][j]) : 0);
      if (order) {  // differences of control points are those of the derivative
        const over = (x, w) => w > 0 ? x / w : 0;
        control = control.map((piece, k) => (last ? piece.slice(1) : piece).map((p, r) => p.map((x, j) => last ? over(last * (x - piece[r][j]), width[k]) : 0)));
        [size, own] = [size, own].map((each) => rows((j, k, w) => over(2 * last * each[k][j], w)));
        own = rows((j, k) => UP * (own[k][j] + 4 * ROUNDOFF * most(control[k], j)));
      }
      if (![...low, ...high].some(isFinite)) continue;
      found.push(quantity);
      const slack = high.map((h) => 1.1e-6 * (order ? (isFinite(h) ? h : 0) : 1)), excess = rows(() => 0), averages = (BISECTIONS + 2) * control[0].length;
      const off = rows((j, k) => own[k][j] + averages * ROUNDOFF * (most(control[k], j) + slack[j]));
      let open = control.map((piece, k) => ({ piece, k }));
      for (let round = 0; round < BISECTIONS && open.length; round++) open = open.flatMap(({ piece, k }) => {
        const values = (j) => piece.map((p) => p[j]), over = columns.map((j) => Math.max(low[j] - slack[j] - Math.min(...values(j)), Math.max(...values(j)) - high[j] - slack[j]) + off[k][j]);
        if (over.every((x, j) => x <= size[k][j])) {
          over.forEach((x, j) => { excess[k][j] = Math.max(excess[k][j], x); });
          return [];
        }
        for (const end of [piece[0], piece[piece.length - 1]])
          if (!end.every((x, j) => x >= low[j] - slack[j] - size[k][j] && x <= high[j] + slack[j] + size[k][j])) no(k);
        const left = [], right = [];
        for (let rest = piece; rest.length; rest = rest.slice(1).map((p, r) => p.map((x, j) => (rest[r][j] + x) / 2))) {
          left.push(rest[0]);
          right.unshift(rest[rest.length - 1]);
        }
        return [{ piece: left, k }, { piece: right, k }];
      });
      // What is allowed for rounding must have almost no effect in sum.
      const impulse = columns.map((j) => width.reduce((sum, w, k) => sum + excess[k][j] * w + jumps[k][j], 0));
      if (open.length || !(UP * Math.max(...impulse) <= 0.011)) no(0);
    }
    return found;
  }

  // --- bounds on an interval of the curve ---
  /** The box of the joint values in an interval, and the joints at its middle. */
  class Span {
    constructor(proof, begin, end) {
      const { curve, joints } = proof, { knots, degree, columns } = curve;
      let first = 0, last = curve.width.length - 1;
      while (first < last && knots[first + 1] <= begin) first++;
      while (last > first && knots[last] >= end) last--;
      const low = columns.map(() => Infinity), high = columns.map(() => -Infinity), e = UP * (10 * (degree + 1) * ROUNDOFF * curve.size + curve.jump + TINY);
      let control = [];
      for (let k = last; k >= first; k--) {  // control points of a part of a piece are its blossoms
        const u = [begin, end].map((t) => Math.min(Math.max((t - knots[k]) / (curve.single ? 1 : curve.width[k]), 0), 1));
        control = curve.control[k].map((_, r) => {
          let rest = curve.control[k];
          for (let level = 0; level < degree; level++) {
            const at = level < r ? u[1] : u[0];
            rest = rest.slice(1).map((p, m) => p.map((x, j) => rest[m][j] * (1 - at) + x * at));
          }
          return rest[0];
        });
        for (const p of control) p.forEach((x, j) => { low[j] = Math.min(low[j], x); high[j] = Math.max(high[j], x); });
      }
      const q = low.map((x, j) => (x + high[j]) / 2), half = q.map((x, j) => above(Math.max(high[j] - x, x - low[j]) + e));  // q is exact by definition
      this.proof = proof;
      this.single = first === last;
      this.theta = control.map((p) => p.map((x, j) => rounded(x - q[j], e)));
      this.placed = new Map();
      this.joints = /** @type {Row[]} */ ([]);
      for (const { parent, leader, multiplier, offset, revolute, ...joint } of joints) {
        const base = this.at(parent), value = add(times(near(q[leader]), near(multiplier)), near(offset)), share = Math.abs(multiplier);
        let rotation = product(base.rotation, joint.rotation), translation = plus(turned(base.rotation, joint.translation), base.translation);
        const axis = turned(rotation, joint.axis), deviation = UP * share * proof.tolerance[leader], delta = UP * (share * half[leader] + deviation);
        if (revolute) rotation = product(rotation, about(joint.axis, value));
        else translation = plus(translation, scaled(value, axis));
        // Above the chord, and above the second-order term
        const capped = Math.min(delta, Math.PI), [s, c] = sineCosine(near(capped / 2)), two = add(s, s), chord = revolute ? upper(two) : delta;
        const bend = revolute ? UP * (longest([add(near(capped), negative(times(two, c))), times(two, s)]) + 2 * (delta - capped)) : 0;
        this.joints.push({ rotation, translation, axis, revolute, leader, multiplier, deviation, chord, bend, turn: revolute ? chord : 0 });
      }
    }
    /** A joint in the frame of the root. */
    at(k) { return this.joints[k] ?? ROOT; }
    /** A body in the frame of the root. */
    body(body) {
      if (!this.placed.has(body)) {
        const { rotation, translation } = this.at(body.joint), turn = product(rotation, body.rotation), origin = plus(turned(rotation, body.translation), translation);
        this.placed.set(body, { back: transposed(turn), origin, centre: plus(turned(turn, exact(body.centre)), origin), normal: turn.map((row) => row[2]), body });
      }
      return this.placed.get(body);
    }
    /** The support in a direction; of a half-space in that of its normal. No term has more than 10 roundings. */
    reach({ back, origin, body }, d) {
      if (body.halfSpace) return dot(d, origin);
      const local = turned(back, d), [x, y, z] = local.map(({ v }) => v), off = local.reduce((sum, { v, e }) => sum + e + 16 * ROUNDOFF * Math.abs(v), 0);
      return add(near(support(body, x, y, z), UP * off * body.extent + TINY), dot(d, origin));
    }
    /** A lower bound of the distance of two bodies, or parts, along a direction from the first to the second. */
    distance(a, b, along) {
      const one = this.body(a), other = this.body(b), obstacle = b.kind === "obstacle", size = Math.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2);
      const u = b.halfSpace ? reversed(other.normal) : along.map((x) => near(x / size, UNIT_ERROR)), behind = this.reach(other, reversed(u));
      const gap = lower(negative(add(behind, this.reach(one, u)))), [path, up] = this.proof.path(a.joint, b.joint), count = path.length;
      if (!count) return gap;
      const rows = path.map((k) => ({ ...this.joints[k] })), radii = [one, other].map(({ centre, body }, side) => rows.map((row) =>
        side && obstacle ? 0 : row.revolute ? UP * (longest(cross(row.axis, minus(centre, row.translation))) + body.ball) : 1));
      // The joints up to ``split`` move the first body, seen from the link L between them, and the others the second.
      const moved = (s) => UP * rows.reduce((sum, row, c) => sum + radii[c < s ? 0 : 1][c] * row.chord, 0);
      let split = count, rest = 0;
      for (let s = 0; s < count && !obstacle; s++) if (moved(s) < moved(split)) split = s;
      const rough = below(gap - moved(split));
      if (!this.single) return rough;
      rows.forEach((row, c) => {
        const between = c < split ? rows.slice(c + 1, split) : rows.slice(split, c), turn = between.reduce((sum, each) => sum + each.turn, 0);
        rest += radii[c < split ? 0 : 1][c] * (row.bend + turn * row.chord);
        row.g = row.revolute ? cross(u, row.axis) : ZERO;
        row.along = row.revolute ? negative(dot(row.g, row.translation)) : dot(u, row.axis);
      });
      const linear = this.theta.map((theta) => {
        let sum = near(0), first = u, second = reversed(u);
        rows.forEach((row, c) => {
          const change = times(theta[row.leader], near(c < up ? -row.multiplier : row.multiplier));  // a positive one moves the first body nearer
          sum = add(sum, times(change, row.along));
          if (!row.revolute) return;
          if (c < split) first = minus(first, scaled(change, row.g));
          else second = minus(second, scaled(change, row.g));
        });
        return lower(add(sum, negative(add(this.reach(one, first), obstacle ? behind : this.reach(other, second)))));
      });
      // The joint tolerances reduce the distance by the speed of the support, to first order.
      return Math.max(rough, rows.reduce((close, { deviation, revolute, g, along }, c) => {
        if (deviation === 0) return close;
        const forth = (d, by) => upper(add(this.reach(c < split ? one : other, d), by));
        return below(close - UP * deviation * (revolute ? Math.max(forth(g, along), forth(reversed(g), negative(along))) : Math.abs(along.v) + along.e));
      }, below(Math.min(...linear) - UP * rest)));
    }
  }

  // --- the proof ---
  const both = (a, b) => JSON.stringify([a, b].sort());
  async function readProof(file) {
    if (member(file, "", "format") !== "pinproof proof" || member(file, "", "version") !== 3) refuse("format", "this verifier reads 'pinproof proof', version 3");
    checkFields(file, "", "format version made_by claim settings hashes robot curve limits joints bodies notes excluded intervals pairs constraints");
    const curve = await readCurve(member(file, "", "curve")), row = member(file, "", "limits"), limits = /** @type {any[]} */ ([]);
    if (member(member(file, "", "hashes"), "hashes", "curve") !== curve.sha256) refuse("hashes.curve", "does not match the curve in the file");
    if (row !== null) {
      checkFields(row, "limits", "lower upper velocity acceleration");
      const [low, high, ...rates] = ["lower", "upper", "velocity", "acceleration"].map((key) => optional(row, "limits", key, curve.dof, key === "lower" ? -Infinity : Infinity));
      if (!low.every((x, k) => x <= high[k]) || !rates.flat().every((x) => x > 0)) refuse("limits", "lower must not exceed upper, and rates must be above 0");
      limits.push(["position", low, high], ...rates.map((rate, k) => [["velocity", "acceleration"][k], rate.map((x) => -x), rate]));
    }
    const joints = list(file, "", "joints").map((joint, k) => {
      const where = `joints[${k}]`;
      checkFields(joint, where, "name type axis placement parent leader multiplier offset");
      text(joint, where, "name");
      if (!["revolute", "prismatic"].includes(member(joint, where, "type"))) refuse(where + ".type", "must be revolute or prismatic");
      const parent = index(member(joint, where, "parent"), -1, k, where + ".parent"), leader = index(member(joint, where, "leader"), 0, curve.dof, where + ".leader");
      const [multiplier, offset] = ["multiplier", "offset"].map((key) => numbers(joint, where, key, []));
      return { revolute: joint.type === "revolute", parent, leader, multiplier, offset, axis: unitVector(joint, where, "axis"), ...placement(joint, where) };
    });
    const bodies = /** @type {Row[]} */ ([]), owners = new Map(), taken = new Set();
    for (const [i, each] of list(file, "", "bodies").entries()) {
      const body = await readBody(each, i, joints.length), mate = owners.get(body.owner) ?? body;
      if (taken.has(body.name)) refuse(body.where + ".name", "another body has this name too");
      if (mate.joint !== body.joint || mate.kind !== body.kind) refuse(body.where, "the other bodies of its owner have another joint or kind");
      taken.add(body.name);
      owners.set(body.owner, mate);
      bodies.push(body);
    }
    const known = (pair, where) => { for (const name of pair.slice(0, 2)) if (!owners.has(name)) refuse(where, "no body has the owner " + name); };
    const excluded = names(file, "", "excluded"), settings = member(file, "", "settings"), margins = new Map();
    excluded.forEach((each, k) => known([text({ reason: each[2] }, `excluded[${k}]`, "reason") && each[0], each[1]], `excluded[${k}]`));
    checkFields(settings, "settings", "margin margins joint_tolerance obstacle_tolerance");
    const tolerance = numbers(settings, "settings", "joint_tolerance", [curve.dof]), [obstacles, margin] = ["obstacle_tolerance", "margin"].map((key) => numbers(settings, "settings", key, []));
    for (const [k, each] of names(settings, "settings", "margins").entries()) {
      const where = `settings.margins[${k}]`, key = both(each[0], each[1]);
      known(each, where);
      if (margins.has(key)) refuse(where, "the two have a margin already");
      margins.set(key, numbers({ margin: each[2] }, where, "margin", []));
    }
    if (!(Math.min(...margins.values(), ...tolerance, obstacles, margin) >= 0)) refuse("settings", "margins and tolerances must be 0 or more");
    /** The joints from one joint to another, and how many of them, from the first, are up. */
    const path = (a, b) => {
      const up = /** @type {number[]} */ ([]), down = /** @type {number[]} */ ([]);
      while (a !== b) {  // parents have smaller numbers
        if (a > b) a = joints[up[up.push(a) - 1]].parent;
        else b = joints[down[0 * down.unshift(b)]].parent;
      }
      return [[...up, ...down], up.length];
    };
    const pairs = list(file, "", "pairs"), intervals = numbers(file, "", "intervals", [null, 2], 1e12);
    checkIntervals(curve, intervals, "intervals");
    return { curve, limits, bodies, joints, excluded, tolerance, obstacles, margin, margins, path, pairs, intervals };
  }
  function checkIntervals(curve, intervals, where) {
    intervals.forEach(([a, b], k) => (a >= curve.low && b <= curve.high && (curve.single ? a <= b : a < b)) || refuse(`${where}[${k}]`, "must have a length and lie on the curve"));
  }
  function checkCover(curve, intervals, where) {
    let reached = intervals.length ? curve.low : -Infinity;
    for (const [a, b] of [...intervals].sort((x, y) => x[0] - y[0]).concat([[curve.high, curve.high]])) {
      if (a > reached) refuse(where, `nothing is proven between the parameters ${Math.max(reached, curve.low)} and ${a}`);
      reached = Math.max(reached, b);
    }
  }
  function members(proof, k) {
    const where = `pairs[${k}].bodies`, pair = list(proof.pairs[k], `pairs[${k}]`, "bodies");
    if (pair.length !== 2) refuse(where, "must be two bodies");
    const [i, j] = pair.map((value) => index(value, 0, proof.bodies.length, where)), a = proof.bodies[i], b = proof.bodies[j];
    if (i === j || !a.bounded || !(b.bounded || b.halfSpace) || a.kind === "obstacle") refuse(where, "must be two bodies with a shape, an obstacle second");
    return [i, j];
  }
  /** Every two owners are checked, on any level of each of their geometries with all of its bodies, or excluded. */
  function checkComplete(proof) {
    const checked = new Set(proof.pairs.map((_, k) => both(...members(proof, k)))), excluded = new Set(proof.excluded.map(([a, b]) => both(a, b)));
    const group = (bodies, key) => { const map = new Map(); for (const i of bodies) map.set(proof.bodies[i][key], [...map.get(proof.bodies[i][key]) ?? [], i]); return [...map]; };
    const levels = (bodies) => group(bodies, "level").map(([, of]) => of), apart = (one, other) => one.every((i) => other.every((j) => checked.has(both(i, j))));
    group(proof.bodies.keys(), "owner").forEach(([a, ofA], k, owners) => owners.slice(k + 1).forEach(([b, ofB]) => {
      if ([ofA, ofB].every(([i]) => proof.bodies[i].kind === "obstacle") || excluded.has(both(a, b))) return;
      for (const [, one] of group(ofA, "geometry")) for (const [, other] of group(ofB, "geometry"))
        if (!levels(one).some((x) => levels(other).some((y) => apart(x, y)))) refuse("pairs", `${a} and ${b} are neither checked nor excluded`);
    }));
  }
  /** The intervals of a pair, their directions, and what each separates: bodies, or parts of meshes. */
  function readPair(proof, k, parts) {
    const pair = proof.pairs[k], of = members(proof, k), bodies = of.map((i) => proof.bodies[i]), where = `pairs[${k}] (${bodies[0].name} and ${bodies[1].name})`;
    checkFields(pair, where, "bodies intervals directions parts");
    const rows = list(pair, where, "intervals").map((row) => index(row, 0, proof.intervals.length, where + ".intervals")), spans = rows.map((row) => proof.intervals[row]);
    const directions = numbers(pair, where, "directions", [rows.length, 3]), meshes = [0, 1].filter((side) => bodies[side].triangles), pieces = bodies.map((body) => body.triangles?.length ?? 1);
    let ranges = rows.map(() => [[0, 1], [0, 1]]);
    if (!meshes.length && Object.hasOwn(pair, "parts")) refuse(where + ".parts", "must be missing, since both bodies are convex");
    if (!meshes.length) checkCover(proof.curve, spans, where);
    else {
      const stated = numbers(pair, where, "parts", [rows.length, 2 * meshes.length], 1e12);
      ranges = ranges.map((row, r) => row.map((whole, side) => meshes.includes(side) ? stated[r].slice(2 * meshes.indexOf(side)).slice(0, 2) : whole));
      if (!ranges.every((row) => row.every(([a, b], side) => Number.isInteger(a) && Number.isInteger(b) && a >= 0 && a < b && b <= pieces[side])))
        refuse(where + ".parts", "must be the first of some triangles, and the one after the last");
      checkParts(proof.curve, spans, ranges, pieces, where);
    }
    const required = above((proof.margins.get(both(bodies[0].owner, bodies[1].owner)) ?? proof.margin) + (bodies[1].kind === "obstacle" ? proof.obstacles : 0));
    return rows.map((row, r) => ({ row, direction: directions[r], where, required, separated: bodies.map((body, side) => {
      const [a, b] = ranges[r][side], key = [of[side], a, b].join();
      if (!parts.has(key)) parts.set(key, body.triangles ? partOf(body, a, b) : body);
      return parts.get(key);
    }) }));
  }
  /** Between two consecutive ends of intervals, rectangles in the plane of the triangles of both bodies cover all of it. */
  function checkParts(curve, spans, ranges, pieces, where) {
    const unique = (values) => [...new Set(values)].sort((a, b) => a - b), ends = unique([curve.low, curve.high, ...spans.flat()]);
    for (const [t, begin] of (curve.single ? ends : ends.slice(0, -1)).entries()) {
      const end = ends[t + 1] ?? begin, valid = ranges.filter((_, r) => spans[r][0] <= begin && spans[r][1] >= end);
      if (!valid.length) refuse(where, `nothing is proven between the parameters ${begin} and ${end}`);
      const lines = [0, 1].map((side) => unique([0, pieces[side], ...valid.flatMap((row) => row[side])])), [m, n] = lines.map((line) => line.length);
      if (m * n > 2 ** 24 || ends.length * spans.length > 2 ** 31) refuse(where + ".parts", "are too many");
      // How many rectangles begin or end at each corner of a cell, and from their sums, how many contain it
      const at = lines.map((line) => new Map(line.map((value, c) => [value, c]))), number = new Int32Array((m + 1) * (n + 1));
      for (const [a, b] of valid) for (const [i, j] of [[0, 0], [0, 1], [1, 0], [1, 1]]) number[(Number(at[0].get(a[i])) + 1) * (n + 1) + Number(at[1].get(b[j])) + 1] += i === j ? 1 : -1;
      for (let i = 1; i < m; i++) for (let j = 1; j < n; j++) {
        const here = i * (n + 1) + j, before = here - n - 1;
        if ((number[here] += number[before] + number[here - 1] - number[before - 1]) < 1) refuse(where + ".parts", `leave out the triangles ${lines[0][i - 1]} and ${lines[1][j - 1]} at the parameter ${begin}`);
      }
    }
  }
  /** No body of a pair is inside the mesh of the other at the start; their surfaces are apart on the whole curve. */
  function checkOutside(proof) {
    const start = new Span(proof, proof.curve.low, proof.curve.low);
    for (const [i, j] of proof.pairs.map((_, k) => members(proof, k).map((i) => proof.bodies[i]))) {
      for (const [outer, inner] of [[i, j], [j, i]]) for (const point of outer.solid ? witnesses(inner) : []) {
        const { back, origin } = start.body(outer), from = start.body(inner), local = turned(back, minus(plus(turned(transposed(from.back), exact(point)), from.origin), origin));
        if (!(winding(outer, local.map(({ v }) => v), longest(local.map(({ e }) => near(0, e)))) < 0.5)) refuse(inner.where, `a part of ${inner.name} is inside ${outer.name}, or in its surface`);
      }
    }
  }

  /**
   * Verify a parsed proof; one that does not hold has a `reason`. `progress` gets shares from 0 to 1, and is waited for.
   * @param {any} file @param {(share: number) => Promise<void> | void} progress
   */
  async function verify(file, progress = () => {}) {
    try {
      const proof = await readProof(file), parts = new Map();
      checkComplete(proof);
      const rows = proof.pairs.flatMap((_, k) => readPair(proof, k, parts));
      for (const { direction: [x, y, z], where } of rows) if (!(Math.abs(Math.sqrt(x * x + y * y + z * z) - 1) <= 1e-3)) refuse(where + ".directions", "must be unit vectors");
      // The distance that each direction proves must be larger than the margin.
      let least = Infinity, span = new Span(proof, proof.curve.low, proof.curve.low), last = -1;
      for (const [n, { row, direction, separated: [a, b], where, required }] of rows.sort((x, y) => x.row - y.row).entries()) {
        const [begin, end] = proof.intervals[row];
        if (row !== last) span = new Span(proof, begin, end);
        last = row;
        const bound = span.distance(a, b, direction);
        if (!(bound > required)) refuse(where, `on [${begin}, ${end}] a distance of ${bound} m is proven; it must be larger than ${required} m`);
        least = Math.min(least, below(bound - (b.kind === "obstacle" ? proof.obstacles : 0)));
        if (n % 64 === 0) await progress(n / rows.length);
      }
      checkOutside(proof);
      const claim = member(file, "", "claim");
      checkFields(claim, "claim", "status clearance");
      if (member(claim, "claim", "status") !== "FREE") refuse("claim.status", "must be FREE");
      const claimed = member(claim, "claim", "clearance") === null ? Infinity : numbers(claim, "claim", "clearance", []);
      if (!(claimed <= least)) refuse("claim.clearance", `${claimed} m is claimed, ${least} m is proven`);
      return { ok: true, reason: "", clearance: least, pairs: proof.pairs.length, intervals: rows.length, excluded: proof.excluded.length, limits: checkLimits(proof.curve, proof.limits) };
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      return { ok: false, reason: error.message, clearance: NaN, pairs: 0, intervals: 0, excluded: 0, limits: [] };
    }
  }

  /** The proof of a text. Repeated keys, of which readers may use either, are refused. @param {string} text */
  function read(text) {
    // JSON has one name for each key, if it is valid; a text between quotation marks before a colon is a key.
    const file = JSON.parse(text), written = text.match(/"(?:[^"\\]|\\.)*"(?:\s*:)?/g)?.filter((token) => token.endsWith(":")).length ?? 0;
    const keys = (value) => typeof value !== "object" || value === null ? 0 : Object.values(value).reduce((sum, part) => sum + keys(part), Array.isArray(value) ? 0 : Object.keys(value).length);
    if (keys(file) !== written) throw new SyntaxError("a key is repeated");
    return file;
  }

  return { read, verify };
})();
