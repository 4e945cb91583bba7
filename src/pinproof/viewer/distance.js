// The closest points of two drawn bodies. A tree of spheres bounds the triangles of each mesh; pairs of spheres that are
// farther apart than the best pair of points are skipped (S. Quinlan, 1994, "Efficient distance computation between
// non-convex objects").
/** @typedef {{centre: any, radius: number, parts: Ball[], triangles: any[][]}} Ball */
const MOST_TRIANGLES = 4;
/** @type {WeakMap<object, Ball>} */
const trees = new WeakMap();

/** The tree of some triangles. @param {any[][]} triangles @returns {Ball} */
function ballAround(triangles) {
  const corners = triangles.flat(), box = new THREE.Box3().setFromPoints(corners);
  const centre = box.getCenter(new THREE.Vector3()), size = box.getSize(new THREE.Vector3()).toArray();
  const radius = Math.sqrt(corners.reduce((most, corner) => Math.max(most, corner.distanceToSquared(centre)), 0));
  if (triangles.length <= MOST_TRIANGLES) return { centre, radius, parts: [], triangles };
  const axis = size.indexOf(Math.max(...size)), along = (triangle) => triangle.reduce((sum, corner) => sum + corner.getComponent(axis), 0);
  const sorted = [...triangles].sort((one, other) => along(one) - along(other)), half = sorted.length >> 1;
  return { centre, radius, parts: [ballAround(sorted.slice(0, half)), ballAround(sorted.slice(half))], triangles: [] };
}

function treeOf(mesh) {
  const shape = mesh.geometry, at = shape.attributes.position, index = shape.index;
  const corner = (k) => new THREE.Vector3().fromBufferAttribute(at, index ? index.getX(k) : k);
  const count = (index ?? at).count / 3;
  if (!trees.has(shape)) trees.set(shape, ballAround(Array.from({ length: count }, (_, k) => [0, 1, 2].map((c) => corner(3 * k + c)))));
  return trees.get(shape);
}

/** The closest points of two segments (C. Ericson, 2005, "Real-time collision detection", 5.1.9). */
function closestOfSegments(p, q, r, s) {
  const along = q.clone().sub(p), across = s.clone().sub(r), gap = p.clone().sub(r);
  const clamp = (value) => Math.min(Math.max(value, 0), 1);
  const a = along.lengthSq() || 1e-30, e = across.lengthSq() || 1e-30, b = along.dot(across), c = along.dot(gap), f = across.dot(gap);
  const parallel = a * e - b * b <= 1e-12 * a * e;
  let first = parallel ? 0 : clamp((b * f - c * e) / (a * e - b * b)), second = (b * first + f) / e;
  if (second < 0 || second > 1) {
    second = clamp(second);
    first = clamp((b * second - c) / a);
  }
  return [p.clone().addScaledVector(along, first), r.clone().addScaledVector(across, second)];
}

/** Pairs of points of two triangles, the closest ones among them. */
function* pairsOfPoints(one, other) {
  const edges = (corners) => corners.map((corner, k) => [corner, corners[(k + 1) % 3]]);
  for (const [tips, corners, turned] of [[one, other, false], [other, one, true]]) {
    const triangle = new THREE.Triangle(...corners);
    for (const tip of tips) {
      const pair = [tip, triangle.closestPointToPoint(tip, new THREE.Vector3())];
      yield turned ? pair.reverse() : pair;
    }
    for (const [start, end] of edges(tips)) {  // an edge that pierces the triangle
      const ray = new THREE.Ray(start, end.clone().sub(start).normalize());
      const hit = ray.intersectTriangle(...corners, false, new THREE.Vector3());
      if (hit && hit.distanceTo(start) <= start.distanceTo(end)) yield [hit, hit];
    }
  }
  for (const [p, q] of edges(one)) for (const [r, s] of edges(other)) yield closestOfSegments(p, q, r, s);
}

/** The distance and the closest points of two groups of visible meshes, in the frame of the world of three.js. */
function closestPoints(first, second) {
  const best = { distance: Infinity, points: [] };
  const meshes = (body) => { const found = []; body.updateWorldMatrix(true, true); body.traverseVisible((thing) => thing.isMesh && found.push(thing)); return found; };
  for (const one of meshes(first)) for (const other of meshes(second)) {
    // In the frame of the first mesh
    const there = one.matrixWorld.clone().invert().multiply(other.matrixWorld), place = (point) => point.clone().applyMatrix4(there);
    const gap = (a, b) => a.centre.distanceTo(place(b.centre)) - a.radius - b.radius;
    const visit = (a, b) => {
      if (gap(a, b) >= best.distance) return;
      if (a.parts.length && (a.radius > b.radius || !b.parts.length)) a.parts.map((part) => [part, b]).sort(nearer).forEach(([x, y]) => visit(x, y));
      else if (b.parts.length) b.parts.map((part) => [a, part]).sort(nearer).forEach(([x, y]) => visit(x, y));
      else for (const placed of b.triangles.map((corners) => corners.map(place))) for (const triangle of a.triangles) {
        for (const [p, q] of pairsOfPoints(triangle, placed)) {
          if (p.distanceTo(q) >= best.distance) continue;
          Object.assign(best, { distance: p.distanceTo(q), points: [p, q].map((point) => point.clone().applyMatrix4(one.matrixWorld)) });
        }
      }
    };
    const nearer = (pair, next) => gap(...pair) - gap(...next);
    visit(treeOf(one), treeOf(other));
  }
  return best;
}
