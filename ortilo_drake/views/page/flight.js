"use strict";
// Plays a flight: one time drives the 3D scene, the plan, the plots' cursors, the lamps and the camera's picture.
const flight = (() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = (id) => document.getElementById(id);
  const start = data.time[0], end = data.time[data.time.length - 1];
  const scene = at("scene"), seekBar = at("seek"), picture = document.querySelector("#eye img");
  let time = start, playing = false, before = null, following = false, atHome = false, shownPicture = -1;
  seekBar.min = start;
  seekBar.max = end;

  function lastAtOrBefore(times, t) { // its index, -1 if there is none
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t + 1e-6) low = middle + 1; else high = middle;
    }
    return low - 1;
  }

  function between(points, t) { // a position at time t, on the line between two ticks
    const k = Math.max(0, lastAtOrBefore(data.time, t)), next = Math.min(k + 1, points.length - 1);
    const step = data.time[next] - data.time[k];
    const part = step > 0 ? Math.min(1, Math.max(0, (t - data.time[k]) / step)) : 0;
    return points[k].map((value, i) => value + part * (points[next][i] - value));
  }

  function lampState(sensor, t) {
    if (sensor.blackouts.some(([from, to]) => from <= t + 1e-6 && t + 1e-6 < to)) return "blackout";
    const last = lastAtOrBefore(sensor.arrivals, t);
    return last >= 0 && t - sensor.arrivals[last] <= data.lampSeconds + 1e-6 ? "fix" : "none";
  }

  function viewer() { // Meshcat's, once its animation is loaded
    const found = scene.contentWindow && scene.contentWindow.viewer;
    return found && found.animator.actions.length > 0 ? found : null;
  }

  function showRoom(view) { // from the south and above, as meshcat_room.aim_camera, but for any window
    const [low, high] = data.room, width = high[0] - low[0], depth = high[1] - low[1];
    const half = Math.tan(view.camera.fov * Math.PI / 360);
    const distance = Math.max(width / view.camera.aspect, depth) / 2 / half + 0.5 * depth;
    const target = view.controls.target.set((low[0] + high[0]) / 2, low[2], -(low[1] + high[1]) / 2);
    view.camera.position.set(target.x, target.y + 0.73 * distance, target.z + 0.68 * distance);
  }

  function moveCamera(view, p) { // Meshcat's camera has y up
    const controls = view.controls, camera = view.camera;
    if (!atHome && !following) showRoom(view);
    atHome = true;
    if (following) {
      const offset = camera.position.clone().sub(controls.target);
      controls.target.set(p[0], p[2], -p[1]);
      camera.position.copy(controls.target).add(offset);
    }
    view.set_dirty();
  }

  function show() {
    const p = between(data.truth, time), q = between(data.estimate, time);
    const x = 1000 * (time - start) / Math.max(end - start, 1e-9);
    seekBar.value = time;
    at("clock").textContent = `${time.toFixed(1)} / ${end.toFixed(1)} s`;
    document.querySelectorAll(".cursor").forEach((line) => line.setAttribute("d", `M${x} 0V100`));
    for (const [id, place] of [["at-truth", p], ["at-estimate", q]]) {
      at(id).setAttribute("cx", place[0]);
      at(id).setAttribute("cy", place[1]);
    }
    data.sensors.forEach((sensor, i) => {
      const state = lampState(sensor, time), lamp = at(`lamp-${i}`);
      lamp.dataset.state = state;
      lamp.querySelector("b").textContent = { fix: "fix", blackout: "blackout", none: "–" }[state];
    });
    if (picture) {
      const k = Math.max(0, lastAtOrBefore(data.pictures.time, time));
      if (k !== shownPicture) picture.src = `data:image/jpeg;base64,${data.pictures.jpeg[shownPicture = k]}`;
    }
    const view = viewer();
    if (view) {
      if (view.animator.playing) view.animator.pause();
      view.animator.seek(time - start);
      moveCamera(view, p);
    }
  }

  function seek(t) {
    time = Math.min(end, Math.max(start, t));
    show();
  }

  function setPlaying(on) {
    if (on && time >= end) time = start;
    playing = on;
    before = null;
    at("play").textContent = on ? "Pause" : "Play";
    if (on) requestAnimationFrame(step);
  }

  function step(now) {
    if (!playing) return;
    if (before !== null) seek(time + (now - before) / 1000 * Number(at("speed").value));
    before = now;
    if (time >= end) setPlaying(false); else requestAnimationFrame(step);
  }

  function setFollowing(on) {
    following = on;
    at("follow").setAttribute("aria-pressed", on);
    at("fit").setAttribute("aria-pressed", !on);
    const view = viewer();
    if (!view) return;
    showRoom(view);
    if (on) view.camera.position.sub(view.controls.target).setLength(5).add(view.controls.target);
    show();
  }

  at("play").onclick = () => setPlaying(!playing);
  at("follow").onclick = () => setFollowing(true);
  at("fit").onclick = () => setFollowing(false);
  seekBar.oninput = () => seek(Number(seekBar.value));
  document.querySelectorAll(".plot svg").forEach((plot) => {
    plot.onclick = (event) => {
      const box = plot.getBoundingClientRect();
      seek(start + (event.clientX - box.left) / box.width * (end - start));
    };
  });
  document.addEventListener("keydown", (event) => {
    if (event.target !== document.body) return;
    if (event.key === " ") { event.preventDefault(); setPlaying(!playing); }
    if (event.key === "ArrowRight" || event.key === "ArrowLeft") seek(time + (event.key === "ArrowRight" ? 1 : -1));
  });
  const ready = setInterval(() => { if (viewer()) { clearInterval(ready); show(); } }, 100);
  show();
  return { seek, time: () => time, playing: () => playing, viewer };
})();
