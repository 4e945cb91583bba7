// Picks that are judged again in the page: the grasp of the selected pick, or the base of the robot, is moved, and the
// stages at the grasp are judged in the order of Python, with the core as WebAssembly (compute.js).
const again = settings.livePicks;
const STAGES = ["reach", "limits", "self-collision", "grasp"];

/** The configurations at a target, of the arm (0) or with wider limits (1), and whether they are all. */
function configurationsAt({ model, web }, arm, target) {
  const found = [];
  let complete = web.sweep === null && web.starts === null;
  for (const value of web.sweep ? web.sweep.values : [null]) {
    if (web.starts) break;
    const from = [...web.home];
    if (value !== null) from[web.sweep.joint] = value;
    const branches = model.branches(arm, target, from);
    complete = complete && Boolean(branches?.complete);
    found.push(...branches?.q ?? []);
  }
  // Without a closed form: a search. Values beyond the limits are not those of the sweep
  const starts = web.starts ?? (web.sweep && arm === 1 && !found.length ? [web.home] : []);
  for (const from of starts) {
    const one = model.solve(arm, target, from);
    if (one?.reached && !found.some((q) => q.every((v, k) => Math.abs(v - one.q[k]) < 1e-3))) found.push(one.q);
  }
  return { q: found, complete };
}

/** The same pose with joints inside their limits by full rotations where possible. */
const turnedInside = (web, q) => q.map((v, k) => {
  const by = insideBy(web.joints[k], v), turns = 2 * Math.PI * Math.ceil((-by - 1e-9) / (2 * Math.PI));
  if (by >= 0 || web.joints[k].unit !== "rad") return v;
  return [v + turns, v - turns].find((turned) => insideBy(web.joints[k], turned) >= -1e-9) ?? v;
});
const excess = (web, q) => q.map((v, k) => Math.max(-insideBy(web.joints[k], v), 0));

/** Contacts at q without those of the hand with its object; whether these two are the closest ones is `near`. */
function contactsAt({ model, owners, hand }, object, q) {
  const checked = model.check(q), allowed = ({ a, b }) => [[a, b], [b, a]].some(([one, other]) => owners[other] === object && hand.has(owners[one]));
  const near = checked.closest !== null && allowed(checked.closest);
  return { ...checked, near, contacts: checked.contacts.filter((pair) => !allowed(pair)), closest: near ? null : checked.closest };
}

/**
 * The verdict on a group of grasps (root_from_tip): the number of stages that are passed, the reason of the one that
 * failed, and the configurations to show, the first of which is free if all stages are passed.
 */
function judgeGroup(cell, object, members) {
  const { model, web } = cell, targets = members.map((grasp) => rowsOf(grasp.clone().multiply(cell.tipFromTcp)));
  const every = targets.map((target) => configurationsAt(cell, 0, target));
  let complete = every.every((found) => found.complete), reached = every.flatMap(({ q }) => q);
  const more = () => complete ? "" : "; more IK solutions may exist";
  if (!reached.length) {
    const wide = targets.map((target) => configurationsAt(cell, 1, target));
    const inside = wide.flatMap(({ q }) => q).map((q) => turnedInside(web, q)), by = inside.map((q) => excess(web, q).reduce((a, b) => a + b, 0));
    const best = by.indexOf(Math.min(...by));
    complete = wide.every((found) => found.complete);
    if (best < 0) {
      const near = model.solve(0, targets[0], web.home);
      const far = near ? ": the nearest configuration found is " + (1000 * near.position).toFixed(1) + " mm and " + (near.orientation / DEGREE).toFixed(1) + " deg from the target" : "";
      return { passed: 0, reason: "out of reach" + far + more(), q: [], count: 0 };
    }
    if (by[best] > 1e-12) {
      const beyond = excess(web, inside[best]);
      const words = web.joints.filter((_, k) => beyond[k] > 0).map(({ name, lower, upper }) => {
        const k = web.joints.findIndex((joint) => joint.name === name);
        return name + " = " + inside[best][k].toPrecision(4) + " is outside [" + lower.toPrecision(4) + ", " + upper.toPrecision(4) + "]";
      });
      return { passed: 1, reason: "reachable only outside the joint limits: " + words.join("; "), q: [], count: inside.length };
    }
    reached = [inside[best]];
  }
  const checks = reached.map((q) => ({ q, found: contactsAt(cell, object, q) }));
  let free = checks.filter(({ found }) => !found.contacts.length);
  if (!free.length && cell.exact) free = checks.filter(({ q }) => !contactsAt(cell.exact, object, q).contacts.length);  // hulls touch, meshes do not
  if (free.length) return { passed: 4, reason: free.length + " of " + reached.length + " IK solutions collision-free", q: free.map(({ q }) => q), count: reached.length };
  const isOwn = ({ a, b }) => ![a, b].some((body) => cell.obstacles.has(cell.owners[body]));
  const eligible = checks.filter(({ found }) => !found.contacts.some(isOwn)), passed = eligible.length ? 3 : 2;
  const shown = (eligible.length ? eligible : checks).sort((one, other) => one.found.contacts.length - other.found.contacts.length)[0];
  const hulls = cell.exact || !cell.web.hulls ? "" : "; convex hulls of meshes are checked here, Python also checks the meshes";
  const all = reached.length > 1 ? "; all " + reached.length + " IK solutions collide" : "";
  return { passed, reason: describeContacts(web, shown.found.contacts, null).text + all + more() + hulls, q: [shown.q], count: reached.length };
}

function offerPicks() {
  const panel = Object.assign(make("section"), { id: "live", ariaLabel: "Move grasps and the base of the robot" });
  if (byId("choice")) byId("choice").after(panel);
  else byId("list").prepend(panel);
  const paragraph = (id, name = "state") => Object.assign(make("p", "", name), { id });
  const details = make("details"), state = paragraph("live-state"), count = paragraph("live-count"), stages = Object.assign(make("ul"), { id: "live-stages" });
  const pair = paragraph("live-pair"), figures = paragraph("live-figures"), scope = paragraph("live-scope"), things = Object.assign(make("select"), { id: "live-thing", ariaLabel: "What is moved" });
  count.setAttribute("role", "status");
  const proven = "Proven: the motions of the good picks. ";
  state.textContent = proven + "Nothing was moved.";
  things.append(new Option("Grasp of the selected pick", "grasp"));
  if (again.arms === 1) things.append(new Option("Robot (its base, on the floor)", "base"));
  const entries = poseEntries((pose) => moveTo(pose, true));
  const buttons = makeButtons([
    ["live-next", "Next IK solution", () => {
      solution++;
      show();
    }],
    ["live-yaml", "Copy as YAML", asYaml],
    ["live-command", "Copy as command", asCommand],
    ["live-undo", "Undo all", undo],
  ]);
  details.append(make("summary", again.arms === 1 ? "Move this grasp or the base" : "Move this grasp"), things, ...entries.parts, count, stages, pair, figures, scope, ...buttons);
  panel.append(state, details);

  // --- the cells of the hands, what was moved, and the verdicts ---
  const cells = [], shifts = new Map(), carried = new Map();  // displacements of grasps by row, and of objects by name
  let base = new THREE.Matrix4(), row = 0, solution = 0, showing = false, chosenAnew = false, turn = 0, judged = 0, checked = null, shownCell = null;
  const verdicts = again.rows.map(() => /** @type {any} */ (null));
  const isMoved = () => shifts.size > 0 || !base.equals(new THREE.Matrix4());
  const obstacles = new Map(again.hands.flatMap((web) => web.obstacles.map((thing) => [thing.name, thing])));
  const picture = pictureOf(obstacles);

  async function load() {
    const core = await unpack(byId("core").textContent);
    const model = async (id, web) => byId(id) && CellModel.load(core, new Float64Array(await unpack(byId(id).textContent)), web.arms.length + 1);
    for (const [k, web] of again.hands.entries()) {
      const shared = { web, q: [...web.home], hand: new Set(web.hand), obstacles: new Map(web.obstacles.map((thing) => [thing.name, thing])) };
      const exact = await model("exact" + k, web);
      cells.push({ ...shared, model: await model("cell" + k, web), owners: web.owners, tipFromTcp: matrixOf(web.tip).invert(),
        exact: exact && { ...shared, model: exact, owners: web.exactOwners } });
    }
    atHome = cells[0].model.check(cells[0].web.home);
    judgeAll();
    refresh();
  }
  const models = () => cells.flatMap((cell) => [cell.model, cell.exact?.model]).filter(Boolean);

  /** The pose of the first grasp of a pick now, and its grasps in groups, each with its cell. */
  const shiftOf = (k) => shifts.get(k) ?? new THREE.Matrix4();
  const poseNow = () => things.value === "base" ? base.clone() : again.rows[row] ? shiftOf(row).clone().multiply(matrixOf(again.rows[row].grasps[0].pose)) : new THREE.Matrix4();
  function* groupsOf(k) {
    for (const grasp of again.rows[k].grasps) {
      const then = matrixOf(grasp.pose), now = shiftOf(k).clone().multiply(then), family = again.families[grasp.family];
      const rotation = new THREE.Matrix4().extractRotation(now).invert().multiply(new THREE.Matrix4().extractRotation(then));
      const turns = family.turns.map((rows) => {  // about an axis of the tip, or of the root
        const one = matrixOf(rows);
        return grasp.rooted ? rotation.clone().multiply(one).multiply(rotation.clone().invert()) : one;
      });
      for (const group of family.groups)
        yield { cell: cells[grasp.hand], members: group.flatMap((rows) => turns.map((one) => now.clone().multiply(one).multiply(matrixOf(rows)))) };
    }
  }

  function judge(k) {
    let best = null;
    if (!again.rows[k] || (again.rows[k].onRobot && !base.equals(new THREE.Matrix4()))) return null;  // it would move with the base
    for (const { cell, members } of groupsOf(k)) {
      const found = { ...judgeGroup(cell, again.rows[k].object, members), cell };
      if (!best || found.passed > best.passed) best = found;
      if (best.passed === STAGES.length) break;
    }
    return best;
  }

  function judgeAll() {
    const mine = ++turn;
    let k = 0;
    judged = 0;
    const step = () => {
      if (mine !== turn) return;
      const end = performance.now() + 20;
      while (k < verdicts.length && performance.now() < end) verdicts[k] = judge(k++);
      judged = k;
      if (k < verdicts.length) setTimeout(step);
      drawVerdicts();
    };
    step();
  }

  // --- moving ---
  function moveTo(pose, exact = false) {
    if (!cells.length || !isPose(pose)) return;
    if (!exact) pose = entries.snapped(pose);
    if (things.value === "base") {
      const [x, y, z, , , yaw] = valuesOf(pose);
      base = poseOf([x, y, z, 0, 0, yaw]);
      for (const model of models()) model.move(-1, -1, rowsOf(base));
    } else if (again.rows[row]) displace(row, pose.clone().multiply(matrixOf(again.rows[row].grasps[0].pose).invert()));
    else return;
    changed();
  }

  function displace(k, shift) {
    const thing = obstacles.get(again.rows[k].object), put = (map, key) => shift ? map.set(key, shift) : map.delete(key);
    put(shifts, k);
    if (!thing) return;
    // Picks whose poses are in the frame of the object move with it, as they do when the file of the scene is changed
    put(carried, thing.name);
    again.rows.forEach((own, j) => own?.anchor === thing.name && put(shifts, j));
    for (const cell of cells) for (const model of [cell.model, cell.exact?.model]) {
      const own = cell.obstacles.get(thing.name);  // the cells of several arms may have other obstacles
      if (own) model?.move(...own.bodies, rowsOf(shiftOf(k)));
    }
    if (!shift) nodeOf("scene", thing.name).set_transform(matrixOf(thing.pose).toArray());
  }

  function changed() {
    if (animator.playing) animator.pause();
    showing = isMoved();
    solution = 0;
    verdicts[row] = judge(row);
    judgeAll();
    refresh();
  }

  function undo() {
    for (const k of [...shifts.keys()]) displace(k, null);
    base = new THREE.Matrix4();
    for (const model of models()) model.move(-1, -1, rowsOf(base));
    changed();
    leave();
  }

  // Back to the motion, which the player moves
  function leave() {
    showing = false;
    placeFrames(again.hands[0].frames, atHome.poses);
    picture.paint(new Set());
    picture.drawPair(null);
    hideOthers();
    if (settings.moments) seek(animator.time);
    else if (!animator.playing) onChoose(row);
    refresh();
  }

  // --- what is shown ---
  let atHome = null;
  const cone = new THREE.ConeGeometry(0.012, 0.05, 12).rotateX(Math.PI / 2).translate(0, 0, -0.025);
  const arrows = new THREE.InstancedMesh(cone, new THREE.MeshPhongMaterial({ color: 0xffffff }), again.rows.length);
  Object.assign(arrows, { frustumCulled: false, visible: false });
  picture.group.add(arrows);
  const marks = rows.map((one) => one.cells[one.cells.length - 1].appendChild(make("span", "", "here")));

  function hideOthers() {
    if (byId("caption")) byId("caption").hidden = showing;  // it is that of the unchanged cell
    for (const name of ["grasps", "hidden grasps", "halo", "riders", "tcp path"]) viewer.scene_tree.find([name]).object.visible = !showing;
    arrows.visible = showing;
    for (const [name, shift] of carried)
      nodeOf("scene", name).set_transform((showing ? shift.clone() : new THREE.Matrix4()).multiply(matrixOf(obstacles.get(name).pose)).toArray());
  }

  function drawVerdicts() {
    const moved = isMoved(), theme = settings.theme, colourOf = (found) => found ? theme[found.passed === STAGES.length ? "good" : "bad"] : theme.muted;
    verdicts.forEach((found, k) => {
      const own = again.rows[k];
      arrows.setMatrixAt(k, own ? shiftOf(k).clone().multiply(matrixOf(own.grasps[0].pose)) : new THREE.Matrix4().makeScale(0, 0, 0));
      arrows.setColorAt(k, new THREE.Color(colourOf(found)));
      marks[k].textContent = !moved ? "" : !found ? "Here: not judged" : found.passed === STAGES.length ? "Here: passes the grasp" : "Here: fails at " + STAGES[found.passed] + ": " + found.reason;
      marks[k].style.color = colourOf(found);
    });
    arrows.instanceMatrix.needsUpdate = true;
    if (arrows.instanceColor) arrows.instanceColor.needsUpdate = true;
    // Parts have the colour of their picks here
    picture.paint(new Set());
    for (const [body, colour] of tinted) {
      const own = verdicts.filter((found, k) => found && bodyOfRow[k] === body), materials = new Set(meshesOf(body).map((mesh) => mesh.material));
      const failed = own.find((found) => found.passed < STAGES.length) ?? own[0];
      for (const tint of tints) if (materials.has(tint[0])) tint[2].set(moved && failed ? colourOf(failed) : colour);
    }
    drawTints();
    if (showing) show();
    const atStart = moved && cells.some((cell) => contactsAt(cell, null, cell.web.home).contacts.length) ? " The home configuration is in contact." : "";
    const known = verdicts.filter(Boolean), passing = known.filter((found) => found.passed === STAGES.length);
    count.textContent = judged < verdicts.length ? "Judging ..." : passing.length + " of " + known.length + " picks pass the grasp"
      + (known.length < verdicts.length ? "; " + (verdicts.length - known.length) + " not judged" : "") + "." + atStart;
    count.className = "state " + (judged < verdicts.length ? "" : passing.length === known.length && !atStart ? "good" : "bad");
    viewer.set_dirty();
  }

  function show() {
    const found = verdicts[row];
    if (!cells.length) return;
    const cell = found?.cell ?? cells[0];
    if (found?.q.length) {
      // The configuration nearest to the one shown, so that the arm follows what is dragged
      const far = (other) => other.reduce((sum, v, k) => sum + Math.abs(v - cell.q[k]), 0), sorted = [...found.q].sort((one, other) => far(one) - far(other));
      cell.q = sorted[solution ? sorted.length > 1 ? 1 + (solution - 1) % (sorted.length - 1) : 0 : 0];
    }
    shownCell = cell;
    checked = contactsAt(cell, again.rows[row]?.object ?? null, cell.q);
    const { touching, text } = describeContacts(cell.web, checked.contacts, checked.closest);
    const free = found?.passed === STAGES.length;
    pair.textContent = !found?.q.length ? "" : free && touching.length ? "Convex hulls of meshes touch, the meshes do not."
      : checked.near && !touching.length ? "Closest: the hand and its object, which may touch; all others are " + millimetres(checked.lower) + " apart or more" : text;
    pair.className = touching.length && !free ? "state bad" : "state";
    figures.textContent = found?.q.length ? figuresOf(cell.web, checked, cell.q) : "";
    if (!showing) return;
    picture.drawPair(found?.q.length && !touching.length ? checked.closest : null);
    picture.paint(new Set(found?.q.length && !free ? checked.contacts.flatMap(({ a, b }) => [cell.owners[a], cell.owners[b]]) : []));
    hideOthers();
    viewer.set_dirty();
  }

  function refresh() {
    const own = again.rows[row], found = verdicts[row], moved = isMoved();
    state.textContent = !moved ? proven + "Nothing was moved." : showing ? "The cell was changed: only the grasp poses are checked. No motion is proven for it."
      : proven + "Shown is the cell without the changes.";
    stages.replaceChildren(...(found ? STAGES.slice(0, found.passed + 1) : []).map((stage, k) => {
      const failed = k === found.passed, what = failed || k === 3 ? ": " + found.reason : k === 0 ? ": " + found.count + " IK solutions" : "";
      return make("li", (failed ? "\u2717 " : "\u2713 ") + stage + what, failed ? "bad" : "good");
    }));
    const object = own && obstacles.has(own.object) ? own.object : null;
    scope.textContent = own ? "Not judged here: " + again.unjudged.join(", ") + ". " + (settings.moments ? "Each pick is judged in the scene at the start of the sequence" + (again.arms > 1 ? ", with the other arms at home. " : ". ") : "") + (things.value === "base" ? "Picks and obstacles stay where they are."
      : object ? object + " moves with the grasp." : "Only the grasp moves: the pick names no obstacle as its object.") : "This row is not judged here.";
    byId("live-next").disabled = !found || found.q.length < 2;
    entries.show(poseNow(), things.value === "base");
    if (details.open && cells.length && (own || things.value === "base")) gizmo.show(poseNow(), found !== null && found.passed < STAGES.length, things.value === "base");
    else gizmo.hide();
    show();
  }

  const gizmo = makeHandle(picture.group, poseNow, moveTo), render = viewer.render.bind(viewer);
  const fingers = Object.values(viewer.scene_tree.find(["open hand"]).children).map(({ object }) => ({ object, home: object.matrix.clone() }));
  viewer.render = () => {
    if (chosenAnew) {  // after the page has posed the robot for the row that was chosen
      chosenAnew = false;
      if (isMoved()) {
        animator.pause();
        showing = true;
      }
      refresh();
    }
    if (showing && animator.playing) leave();
    if (showing && checked) {
      const { web } = shownCell, tcp = web.arms[0].tcp;
      placeFrames(web.frames, checked.poses);
      const moved = new THREE.Matrix4().fromArray([...checked.poses[tcp]]).multiply(new THREE.Matrix4().fromArray([...atHome.poses[tcp]]).invert());
      for (const { object, home } of fingers) {
        object.visible = true;
        object.matrix.multiplyMatrices(moved, home).decompose(object.position, object.quaternion, object.scale);
      }
    }
    render();
    picture.placeGap();
  };
  // Of the picks that are executed at the same time, the one that the reader chose
  const selecting = onSelect, choosing = onChoose, isSelected = (one) => one?.getAttribute("aria-selected") === "true";
  onChoose = (k) => {
    row = k;
    choosing(k);
  };
  onSelect = () => {
    selecting();
    if (!isSelected(rows[row])) row = Math.max(rows.findIndex(isSelected), 0);
    solution = 0;
    chosenAnew = true;
    viewer.set_dirty();
  };
  row = Math.max(rows.findIndex(isSelected), 0);
  details.addEventListener("toggle", () => {
    if (details.open && !cells.length && window.pinproof.live === null) window.pinproof.live = load().catch(withdraw);
    refresh();
    viewer.set_dirty();
  });
  things.addEventListener("change", refresh);

  // --- the change as text ---
  function asYaml() {
    const lines = [];
    for (const [k, shift] of shifts) {
      const { name, frame, anchor, frameAt, grasps, stated } = again.rows[k], moved = carried.get(anchor) ?? new THREE.Matrix4();
      const pose = moved.clone().multiply(matrixOf(frameAt)).invert().multiply(shift).multiply(matrixOf(grasps[0].pose));
      if (stated && !moved.equals(shift)) lines.push("- {name: " + plain(name) + ", " + (frame ? "frame: " + plain(frame) + ", " : "") + poseText(pose, true) + "}  # picks" + (frame ? "" : ", from the base of this page") + "; other keys as before");
    }
    for (const [name, shift] of carried)
      lines.push("- {name: " + plain(name) + ", " + poseText(shift.clone().multiply(matrixOf(obstacles.get(name).pose)), true) + "}  # obstacles of the scene, from the base of this page");
    if (!base.equals(new THREE.Matrix4())) lines.push("base: {" + poseText(base, true) + "}  # from the base of this page");
    return lines.join("\n") || "# nothing was moved";
  }
  function asCommand() {
    const [x, y, z, , , yaw] = valuesOf(base), placed = [x / 1000, y / 1000, z / 1000, yaw * DEGREE].map(short).join(" ");
    // The page does not know where its own base is in the files, which --place and cell place move
    const from = base.equals(new THREE.Matrix4()) ? [] : ["from the base of this page"], after = shifts.size ? ["after the change of the files"] : [];
    return "pinproof " + (again.arms > 1 ? "cell allocate " : settings.moments ? "cell sequence " : "pick ") + quoted(again.file) + (from.length ? " --place '" + placed + "'" : "")
      + (from.length + after.length ? "  # " + [...from, ...after].join(", ") : "");
  }
  const withdraw = (error) => {
    panel.replaceChildren(make("p", "This page does not judge picks again: " + (error.message || error), "state"));
  };
  const now = () => ({ row, q: shownCell?.q, showing, judged, shifts, base: rowsOf(base), contacts: checked?.contacts ?? [], loaded: cells.length,
    verdicts: verdicts.map((found) => found && { stage: STAGES[found.passed] ?? null, reason: found.reason, count: found.count }) });
  Object.assign(window.pinproof, { live: null, again: { moveTo, matrixOf, poseNow, now } });
}
if (again && typeof WebAssembly === "object" && typeof DecompressionStream === "function") offerPicks();
