// The page of proposed grasps: second k of the film shows grasp k; a row of the table goes to its grasp.
let shown = -1;
onChoose = (k) => { animator.pause(); seek(k); };
function followGrasps() {
  const k = Math.min(Math.floor(animator.time + 0.2), rows.length - 1);
  if (k !== shown) {
    shown = k;
    select([k]);
    byId("now").textContent = "grasp " + (k + 1) + ": " + rows[k].cells[1].textContent;
  }
  requestAnimationFrame(followGrasps);
}
byId("clock").style.display = "none";
if (rows.length) followGrasps();
