// The page of one motion, which may be live: the server it came from then sends further commands.
offer(settings.duration, settings.start);

const moment = byId("moment");
moment.hidden = settings.start === null;
moment.addEventListener("click", () => seek(settings.start));
if (/(?:^#|&)still\b/.test(location.hash)) document.body.classList.add("still");
viewer.set_3d_pane_size();
// Whoever waits for the picture is told when it stands: after a frame that was drawn in full.
pictured.then(() => requestAnimationFrame(() => requestAnimationFrame(() => console.info("pinproof: drawn"))));

// The browser itself reconnects when the connection is lost. What it then meets may be another page, at the same
// place: its number tells.
let source = null;
if (settings.live !== null) {
  const away = byId("away");
  source = new EventSource("events");
  source.onmessage = (event) => { for (const command of JSON.parse(event.data)) viewer.handle_command(command); };
  source.onerror = () => { away.hidden = false; };
  source.addEventListener("page", (event) => {
    away.hidden = true;
    if (event.data !== settings.live) location.reload();
  });
  source.addEventListener("closed", () => { away.hidden = false; });
}

window.pinproof = { viewer, seek, setLayer, settings, pictured, events: source, ready: true };
