// A page that computes: sliders of the joints, a target and bodies to drag, and at every pose the contacts, the closest
// pair, the joint limits and the manipulability. It computes in the page, with the core as WebAssembly (compute.js).
const web = settings.web;

async function startLive() {
  if (typeof WebAssembly !== "object" || typeof DecompressionStream !== "function") throw new Error("the browser has no WebAssembly");
  const [core, numbers] = await Promise.all(["core", "cell"].map((id) => unpack(byId(id).textContent)));
  const model = await CellModel.load(core, new Float64Array(numbers), web.arms.length);
  let q = [...web.q];        // the configuration shown
  let trying = false;        // whether it is the user's, and not that of the motion
  let checked = /** @type {Checked} */ (model.check(q)), branches = null, branch = 0, reason = "";
  /** What was moved: root_from_thing by name; "" is the robot. @type {Map<string, any>} */
  const moved = new Map();
  const obstacles = new Map(web.obstacles.map((thing) => [thing.name, thing]));

  // --- panel ---
  const panel = byId("live");
  const details = make("details"), state = make("p", "", "state"), pair = make("p", "", "state"), figures = make("p", "", "state"), say = make("p", "", "reason");
  state.id = "live-state";
  pair.id = "live-pair";
  figures.id = "live-figures";
  say.id = "live-reason";
  say.setAttribute("role", "status");
  details.append(make("summary", "Try other poses"));
  panel.append(state, pair, figures, details);
  const joints = web.joints.map((joint, k) => {
    const line = make("label", "", "joint"), slider = make("input"), entry = numberField(joint.name + " in " + joint.unit, 0, 0.01);
    Object.assign(slider, { type: "range", min: joint.lower, max: joint.upper, step: "any", ariaLabel: joint.name });
    const take = (input) => () => {
      if (input.value === "" || !isFinite(Number(input.value))) return;
      const other = [...q];
      other[k] = Number(input.value);
      branches = null;
      reason = "";
      tryPose(other);
    };
    slider.addEventListener("input", take(slider));
    entry.addEventListener("change", take(entry));
    line.append(Object.assign(make("span", joint.name), { title: joint.name }), slider, entry);
    details.append(line);
    return { joint, slider, entry, line };
  });

  // What is dragged: the target of an arm, the robot, or an obstacle
  const things = make("select");
  things.ariaLabel = "What is moved";
  things.id = "live-thing";
  web.arms.forEach((arm, k) => things.append(new Option("Target of " + arm.name, "arm " + k)));
  things.append(new Option("Robot (its base)", "robot"));
  for (const name of obstacles.keys()) things.append(new Option(name, "obstacle " + name));
  const entries = poseEntries((pose) => moveTo(pose, true));
  const buttons = makeButtons([
    ["live-next", "Next IK solution", () => {
      branch = (branch + 1) % branches.q.length;
      tryPose(branches.q[branch]);
    }],
    ["live-yaml", "Copy as YAML", asYaml],
    ["live-command", "Copy as command", asCommand],
    ["live-undo", "Undo all", () => {
      for (const name of [...moved.keys()]) displace(name, null);
      trying = false;
      reason = "";
      branches = null;
      q = [...web.q];
      shown = NaN;
      refresh();
    }],
  ]);
  details.append(things, ...entries.parts, say, ...buttons);
  panel.hidden = false;

  const target = web.arms.map(() => null);  // where it is not that of the tcp
  function poseNow() {
    const [kind, ...rest] = things.value.split(" "), name = rest.join(" ");
    if (kind === "arm") return (reason ? target[Number(name)] : null) ?? new THREE.Matrix4().fromArray([...checked.poses[web.arms[Number(name)].tcp]]);
    if (kind === "robot") return moved.get("") ?? new THREE.Matrix4();
    return moved.get(name) ?? matrixOf(obstacles.get(name).pose);
  }

  // Move what is selected; `exact` without snapping.
  function moveTo(pose, exact = false) {
    if (!isPose(pose)) return;
    const [kind, ...rest] = things.value.split(" "), name = rest.join(" ");
    if (!exact) pose = entries.snapped(pose);
    if (kind !== "arm") {
      displace(kind === "robot" ? "" : name, pose);
      refresh();
      return;
    }
    // The nearest solution; without one, the reason
    const arm = Number(name), rows = rowsOf(pose), solution = model.solve(arm, rows, q);
    branches = model.branches(arm, rows, q);
    branch = 0;
    target[arm] = null;
    if (solution?.reached) {
      reason = "";
      tryPose(solution.q);
    } else if (solution !== null) {
      target[arm] = pose;
      const far = millimetres(solution.position) + ", " + (solution.orientation / DEGREE).toFixed(1) + "\u00b0";
      reason = branches?.complete && branches.outside && !branches.q.length
        ? "Unreachable: all " + branches.outside + " solutions are outside the joint limits."
        : (branches?.complete && !branches.q.length ? "Unreachable: no configuration has this pose" : "Not reached")
          + "; the closest pose found is " + far + " away.";
      refresh();
    }
  }

  // Place the robot (name "") or an obstacle; null: where it was loaded.
  function displace(name, pose) {
    if (pose === null) moved.delete(name);
    else moved.set(name, pose);
    if (name === "") {
      model.move(-1, -1, rowsOf(pose ?? new THREE.Matrix4()));
      return;
    }
    const thing = obstacles.get(name), loaded = matrixOf(thing.pose), now = pose ?? loaded;
    model.move(thing.bodies[0], thing.bodies[1], rowsOf(now.clone().multiply(loaded.clone().invert())));
    nodeOf("scene", name).set_transform(now.toArray());
  }

  function tryPose(other) {
    if (!other.every(Number.isFinite)) return;
    if (animator.playing) animator.pause();
    trying = true;
    q = other;
    refresh();
  }

  // --- what is shown at a pose ---
  const picture = pictureOf(obstacles);

  function refresh() {
    const now = model.check(q);
    if (now === null) return;
    checked = now;
    const { contacts, closest } = checked, outside = outsideLimits(web, q);
    // Words: what is proven, and what is only checked
    const margin = web.margin > 0 ? " and a margin of " + millimetres(web.margin) : "";
    const only = "Only this pose is checked" + margin + "; nothing is proven about motions.";
    const proven = settings.duration > 0 && web.proven ? "Proven: the motion. " : "";
    state.textContent = (moved.size ? "The cell was changed: " + (proven ? "the proof of the motion does not hold for it. " : "") + only
      : trying ? proven + "Shown is another pose. " + only : proven + "Checked now: the pose shown.") + unknownMargins(web);
    const { touching, text } = describeContacts(web, contacts, closest);
    pair.textContent = text;
    pair.className = touching.length || outside.length ? "state bad" : "state good";
    figures.textContent = figuresOf(web, checked, q);
    picture.drawPair(touching.length ? null : closest);
    if (trying || moved.size) redden(false);
    picture.paint(new Set(trying || moved.size || !settings.touching.length ? contacts.flatMap(({ a, b }) => [web.owners[a], web.owners[b]]) : []));
    // Controls
    joints.forEach(({ slider, entry, line: row, joint }, k) => {
      slider.value = String(q[k]);
      if (document.activeElement !== entry) entry.value = q[k].toFixed(3);
      row.classList.toggle("bad", outside.includes(joint));
    });
    entries.show(poseNow());
    say.textContent = reason || (branches && branches.q.length ? "Solution " + (branch + 1) + " of " + branches.q.length + "." : "");
    say.classList.toggle("bad", reason !== "");
    byId("live-next").disabled = !branches || branches.q.length < 2;
    if (details.open) gizmo.show(poseNow(), reason !== "");
    viewer.set_dirty();
  }

  // --- the motion: its configuration at a time; every frame shows the poses of the cell as it is ---
  let shown = NaN, placed = false;
  const motion = web.motion;
  function atTime(t) {
    const times = motion.times, n = q.length;
    let k = 0;
    while (k < times.length - 2 && times[k + 1] <= t) k++;
    const share = Math.min(Math.max((t - times[k]) / Math.max(times[k + 1] - times[k], 1e-12), 0), 1);
    return q.map((_, j) => motion.q[n * k + j] * (1 - share) + motion.q[n * k + n + j] * share);
  }
  const render = viewer.render.bind(viewer);
  viewer.render = () => {
    const t = animator.time;
    if (motion && t !== shown && animator.actions.length) {
      if (!Number.isNaN(shown) || !trying) {
        trying = false;  // the player took over
        reason = "";
        q = atTime(t);
        shown = t;
        refresh();
      } else shown = t;
    }
    // Once more after the user's pose was left, because the player moves only what the motion moves
    const ours = trying || moved.size > 0;
    if (ours || placed) {
      placed = ours;
      placeFrames(web.frames, checked.poses);
    }
    render();
    picture.placeGap();
  };

  const gizmo = makeHandle(picture.group, poseNow, moveTo);
  details.addEventListener("toggle", () => {
    if (details.open) gizmo.show(poseNow(), reason !== "");
    else gizmo.hide();
    viewer.set_dirty();
  });
  things.addEventListener("change", () => {
    branches = null;
    reason = "";
    refresh();
  });

  // --- the change as text, for the person who computes the certificate ---
  function asYaml() {
    const lines = ["q: [" + q.map(short).join(", ") + "]  # " + web.joints.map(({ name }) => escaped(name).slice(1, -1)).join(", ")];
    for (const [name, pose] of moved) {
      if (name === "") lines.push("base: {" + poseText(pose) + "}  # world_from_robot");
      else lines.push("- {name: " + plain(name) + ", " + poseText(pose) + "}  # obstacles");
    }
    return lines.join("\n");
  }
  function asCommand() {
    // Files that the page does not know have names that do not exist, so that nothing is left out unnoticed.
    const files = (web.obstacles.length ? " --scene SCENE.yaml" : "") + (web.attached.length ? " --attached ATTACHED.yaml" : "");
    const tcp = web.arms.length === 1 ? " --tcp " + quoted(web.frames[web.arms[0].tcp]) : "", margin = web.margin > 0 ? " --margin " + web.margin : "";
    return "pinproof check " + quoted(web.robot) + " --q '" + q.map(short).join(" ") + "'" + tcp + margin + files + (moved.size ? "  # with the scene as changed" : "");
  }

  refresh();
  window.pinproof.model = { model, moveTo, tryPose, displace, matrixOf, now: () => ({ q, checked, trying, reason, branches, moved }) };
}
// Without WebAssembly, or if the module is damaged, the page shows what it was written with.
window.pinproof.live = web ? startLive().catch((error) => {
  byId("live").replaceChildren(make("p", "This page does not check poses: " + (error.message || error), "state"));
  byId("live").hidden = false;
}) : Promise.resolve();
