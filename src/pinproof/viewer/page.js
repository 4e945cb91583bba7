// The page of one motion. A live page receives further commands from the server that sent it.
offer(settings.duration, settings.start, settings.parameter);

const moment = byId("moment");
moment.hidden = settings.start === null;
moment.addEventListener("click", () => seek(settings.start));
if (/(?:^#|&)still\b/.test(location.hash)) document.body.classList.add("still");
viewer.set_3d_pane_size();
// write_png waits for this message, which follows a completely drawn frame.
pictured.then(() => requestAnimationFrame(() => requestAnimationFrame(() => console.info("pinproof: drawn"))));

// The browser reconnects by itself after the connection is lost. If the identifier of the page has changed, it reloads.
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
