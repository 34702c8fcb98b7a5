// A flight's readings beside Meshcat's view: asked for ten times a second, written as text, lamps and plots.
(() => {
  const SHOWN = 20;  // of the flight [s]
  const INK = "#1f2733", FAINT = "#5a6675", BAND = "#bfe0f5", LIT = "#0072b2", DARK = "#dfe3e8";
  const SPARSE = 0.5;  // readings farther apart than that are marked [s]
  const LEFT = 44, RIGHT = 14;  // margins of a plot [px]
  const aside = document.createElement("aside");
  aside.id = "flight";
  aside.innerHTML = `
    <table>
      <tr><td>time<td id="time">–<tr><td>state<td id="state">–
      <tr><td>error of the estimate<td id="error">–<tr><td>its 3 sigma<td id="sd">–
    </table>
    <div id="note">waiting for the first tick</div>
    <h2>Arriving, as the lamps above the vehicle show; share of the last 5 s</h2><div id="lamps"></div>
    ${["x", "y", "z"].map((axis) => `<h2>Error in ${axis} [m] over time [s], 3 sigma in blue</h2><canvas id="of-${axis}"></canvas>`).join("")}
    <h2>Arrived, over time [s]</h2><canvas id="strips"></canvas>`;
  document.body.prepend(aside);
  viewer.set_3d_pane_size();
  const put = (id, text) => { document.getElementById(id).textContent = text; };
  const cm = (metres) => metres === null ? "–" : `${(100 * metres).toFixed(1)} cm`;  // null: it has diverged
  let past = [];

  // The 1, 2 or 5 times a power of ten at or above a length.
  const round = (length) => {
    const ten = 10 ** Math.floor(Math.log10(length));
    return ten * [1, 2, 5, 10].find((times) => times * ten >= length * 0.999);
  };

  // A cleared canvas, with the place of a time in it.
  const begin = (id, height) => {
    const canvas = document.getElementById(id), scale = window.devicePixelRatio;
    if (height) canvas.style.height = `${height}px`;
    canvas.width = canvas.clientWidth * scale;
    canvas.height = canvas.clientHeight * scale;
    const pen = canvas.getContext("2d"), width = canvas.clientWidth, end = Math.max(past.at(-1).time, SHOWN);
    pen.scale(scale, scale);
    pen.font = "11px system-ui, sans-serif";
    pen.textBaseline = "middle";
    const at = (time) => LEFT + (width - LEFT - RIGHT) * (1 - (end - time) / SHOWN);
    return { pen, at, end, right: width - RIGHT, height: canvas.clientHeight };
  };

  const drawTimes = ({ pen, at, end, height }) => {
    pen.fillStyle = FAINT;
    pen.textAlign = "center";
    for (let time = 5 * Math.ceil((end - SHOWN) / 5); time <= end; time += 5) {
      pen.fillText(`${time} s`, at(time), height - 6);
    }
  };

  const drawErrors = (axis, name) => {
    const plot = begin(`of-${name}`), { pen, at, right } = plot, low = plot.height - 16;
    const most = round(Math.max(0.02, ...past.map((one) => Math.max(Math.abs(one.by_axis[axis][0]), one.by_axis[axis][1]))));
    const up = (error) => 6 + (low - 6) * (0.5 - error / (2 * most));
    pen.textAlign = "right";
    for (const tick of [-most, 0, most]) {
      pen.fillStyle = FAINT;
      pen.fillText(`${tick}`.replace("-", "−"), LEFT - 6, up(tick));
      pen.fillStyle = DARK;
      pen.fillRect(LEFT, up(tick), right - LEFT, 1);
    }
    pen.beginPath();
    past.forEach((one) => pen.lineTo(at(one.time), up(one.by_axis[axis][1])));
    past.toReversed().forEach((one) => pen.lineTo(at(one.time), up(-one.by_axis[axis][1])));
    pen.fillStyle = BAND;
    pen.fill();
    pen.beginPath();
    past.forEach((one) => pen.lineTo(at(one.time), up(one.by_axis[axis][0])));
    pen.strokeStyle = INK;
    pen.lineWidth = 1.3;
    pen.stroke();
    pen.fillStyle = INK;
    past.forEach((one, k) => {  // a slow browser: the points, of which the line between is a guess
      if (k && one.time - past[k - 1].time > SPARSE) pen.fillRect(at(one.time) - 2, up(one.by_axis[axis][0]) - 2, 4, 4);
    });
    drawTimes(plot);
  };

  const drawStrips = (sensors) => {
    const plot = begin("strips", 18 * sensors.length + 18), { pen, at, right } = plot;
    sensors.forEach((sensor, row) => {
      pen.fillStyle = INK;
      pen.textAlign = "left";
      pen.fillText(sensor, 0, 18 * row + 8, LEFT - 4);
      past.forEach((one, k) => {
        const to = k + 1 < past.length ? at(past[k + 1].time) : at(one.time);
        pen.fillStyle = one.lit[sensor] ? LIT : DARK;
        pen.fillRect(at(one.time), 18 * row + 2, Math.min(to, right) - at(one.time) + 0.5, 12);
      });
    });
    drawTimes(plot);
  };

  const show = (now) => {
    if (past.length && now.time < past.at(-1).time) past = [];  // it is flown anew
    past = past.filter((one) => one.time > now.time - SHOWN && one.time < now.time);
    if (now.error !== null && now.sd !== null) past.push(now);
    document.title = `${now.scenario}, live`;
    put("time", `${now.time.toFixed(1)} s`);
    put("state", now.is_lost ? "lost" : now.is_paused ? "paused" : "flying");
    put("error", cm(now.error));
    put("sd", cm(now.sd));
    put("note", now.note);
    aside.classList.toggle("lost", now.is_lost);
    const sensors = Object.keys(now.lit), lamps = document.getElementById("lamps");
    lamps.replaceChildren(...sensors.map((sensor) => {
      const lamp = document.createElement("span"), share = now.arrivals[sensor];
      lamp.className = now.lit[sensor] ? "lit" : "";
      lamp.append(document.createElement("i"), `${sensor} ${share == null ? "–" : `${Math.round(100 * share)} %`}`);
      return lamp;
    }));
    if (past.length) {
      ["x", "y", "z"].forEach((name, axis) => drawErrors(axis, name));
      drawStrips(sensors);
    }
  };

  const ask = async () => {
    try {
      const now = await (await fetch("readings", { cache: "no-store" })).json();
      if (now) show(now);
    } catch { /* the flight has ended; Meshcat's page says so */ }
    setTimeout(ask, 100);
  };
  ask();
  if (window.innerWidth > 700) viewer.gui.open();
  viewer.gui.width = 300;
  viewer.gui.__folders.Scene?.close();
})();
