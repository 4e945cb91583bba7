// The proof of the motion is verified again in the page, on request (verifier.js), or the page states how Python does it.
(() => {
  const panel = byId("proof"), words = make("p", "", "state"), withPython = "certificate.save(\"proof.json\") writes it, and "
    + "python -m pinproof.verifier proof.json verifies it with NumPy alone.";
  words.setAttribute("role", "status");
  panel.append(words);
  panel.hidden = false;
  if (!web.proof.included) {
    words.textContent = "The proof is too large for this page (" + (web.proof.bytes / 1e6).toFixed(1) + " MB): " + withPython;
    return;
  }
  /** Whether the proof is about the motion that this page plays, at all its moments. */
  function isOfThisMotion({ joint_names: names, knots, control }) {
    const n = web.q.length, { times } = web.motion, whole = knots[0] <= times[0] && knots[knots.length - 1] >= times[times.length - 1] - 1e-9;
    return whole && web.joints.every(({ name }, j) => names[j] === name) && times.every((time, k) => {
      let piece = 0;
      while (piece < control.length - 1 && knots[piece + 1] <= time) piece++;
      const u = Math.min((time - knots[piece]) / (knots[piece + 1] - knots[piece] || 1), 1);
      let rest = control[piece];
      while (rest.length > 1) rest = rest.slice(1).map((p, m) => p.map((x, j) => rest[m][j] * (1 - u) + x * u));
      return rest[0].length === n && rest[0].every((x, j) => Math.abs(x - web.motion.q[n * k + j]) < 1e-6);
    });
  }
  function describe(verdict, file) {
    if (!verdict.ok) return "The proof does NOT hold: " + verdict.reason;
    if (!isOfThisMotion(file.curve)) return "The proof holds, but for another motion than the one shown.";
    const apart = verdict.pairs ? `all ${verdict.pairs} checked pairs of bodies stay more than ${Math.floor(1e6 * verdict.clearance) / 1000} mm apart`
      + ` at every instant of this motion (${verdict.intervals} inequalities derived again)` : "no pair of bodies is checked";
    const limits = verdict.limits.length ? `; it keeps the limits of ${verdict.limits.join(", ")}` : "";
    const open = [verdict.excluded ? `${verdict.excluded} pairs that are listed above` : "", file.constraints?.length ? "the constraints of the tcp" : ""].filter(Boolean);
    return `The proof holds: ${apart}${limits}. Robot and obstacles are those that the proof describes.`
      + (open.length ? ` Not verified here: ${open.join("; ")}.` : "");
  }
  const button = Object.assign(make("button", "Verify the proof in this page"), { type: "button", id: "verify" });
  const bar = Object.assign(make("progress"), { value: 0, hidden: true, ariaLabel: "Progress of the verification" });
  panel.append(button, bar);
  button.addEventListener("click", async () => {
    Object.assign(button, { disabled: true });
    Object.assign(bar, { hidden: false, value: 0 });
    words.textContent = "";
    let before = performance.now();
    try {
      const file = ProofVerifier.read(new TextDecoder("utf-8", { fatal: true }).decode(await unpack(byId("proof-file").textContent)));
      const verdict = await ProofVerifier.verify(file, async (share) => {
        if (performance.now() - before < 100) return;
        bar.value = share;
        await new Promise((next) => setTimeout(next));  // the page stays responsive
        before = performance.now();
      });
      words.textContent = describe(verdict, file);
      words.className = verdict.ok ? "state good" : "state bad";
    } catch (error) {
      words.textContent = "The proof could not be verified here (" + error + "): " + withPython;
      words.className = "state bad";
    }
    Object.assign(button, { disabled: false });
    bar.hidden = true;
  });
})();
