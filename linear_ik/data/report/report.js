"use strict";
(() => {
  const root = document.documentElement, list = document.getElementById("list"), body = list.tBodies[0];
  const rows = [...body.rows], views = new Map();
  root.classList.add("js");

  // the list: search, filters, sorting ------------------------------------------------------
  const search = document.getElementById("search"), shown = document.getElementById("shown");
  const filters = ["verdict", "status"].map(id => document.getElementById(id)).filter(Boolean);
  function filter() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every(word => text.includes(word)) ||
        filters.some(select => select.value && row.dataset[select.id] !== select.value);
      count += !row.hidden;
    }
    shown.textContent = `${count} shown`;
  }
  search.addEventListener("input", filter);
  filters.forEach(select => select.addEventListener("change", filter));
  document.querySelector(".filters").addEventListener("submit", event => event.preventDefault());
  const collator = new Intl.Collator(undefined, { numeric: true });
  const heads = [...list.tHead.rows[0].cells];
  heads.forEach((head, column) => head.querySelector("button").addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    heads.forEach(other => other.setAttribute("aria-sort", other !== head ? "none" : down ? "descending" : "ascending"));
    const key = row => row.cells[column].dataset.sort ?? row.cells[column].textContent.trim();
    const sorted = [...rows].sort((a, b) => {
      const [p, q] = [key(a), key(b)];
      if (!p || !q) return !p - !q;  // what is not known comes last either way
      const order = p - q || collator.compare(p, q);
      return down ? -order : order;
    });
    body.append(...sorted);
  }));

  // one element at a time -------------------------------------------------------------------
  const articles = [...document.querySelectorAll("article")];
  function address() {
    try { return decodeURIComponent(location.hash); } catch { return ""; }
  }
  function route() {
    const article = articles.find(one => "#/" + one.dataset.key === address());
    articles.forEach(other => other.classList.toggle("open", other === article));
    root.classList.toggle("at-element", Boolean(article));
    if (article) {
      scrollTo(0, 0);
      article.focus({ preventScroll: true });
      view(article.dataset.number).draw();
    }
  }
  document.querySelectorAll(".print").forEach(button => button.addEventListener("click", () => print()));
  addEventListener("hashchange", route);
  addEventListener("resize", () => views.forEach(one => one.draw()));
  addEventListener("beforeprint", () => {
    const alone = root.classList.contains("at-element");
    articles.forEach(article => (!alone || article.classList.contains("open")) && view(article.dataset.number).draw());
    document.querySelectorAll("#run details, article.open details").forEach(folded => { folded.open = true; });
  });

  // 3D --------------------------------------------------------------------------------------
  function bytes(text) {
    return Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  }
  const RAMP = [[41, 97, 242], [250, 217, 64], [230, 38, 31]];
  const COLOURS = Array.from({ length: 16 }, (_, i) => {
    const t = i / 15 * 2, from = RAMP[Math.min(Math.floor(t), 1)], to = RAMP[Math.min(Math.floor(t), 1) + 1];
    const u = t - Math.min(Math.floor(t), 1);
    return `rgb(${from.map((v, c) => Math.round(v + (to[c] - v) * u)).join(",")})`;
  });
  function view(number) {
    if (!views.has(number)) views.set(number, makeView(number));
    return views.get(number);
  }
  function makeView(number) {
    const canvas = document.getElementById("c" + number), box = canvas.closest(".view");
    const data = JSON.parse(document.getElementById("d" + number).textContent);
    const paper = canvas.getContext("2d"), last = data.before.length - 1;
    const show = { before: true, after: true, points: true };
    const points = data.points ? new Int16Array(bytes(data.points).buffer) : new Int16Array(0);
    const along = data.points ? new Uint16Array(bytes(data.along).buffer) : [], far = data.points ? bytes(data.distance) : [];
    let times = 1, zoom = 1;
    const axis = [0, 1, 2].map(c => data.before[last][c] - data.before[0][c]);
    // From the side, a little above; a column is looked at across, a beam along its flank.
    let turn = Math.atan2(axis[1], axis[0]) - Math.PI / 2 + 0.5, tilt = 0.35;

    const shift = (i, c) => (times - 1) * (data.after[i][c] - data.before[i][c]);
    function rings(which) {
      return data[which].map((ring, i) => {
        const t = i / last, move = which === "after" && times > 1;
        return data.start.map((corner, j) => {
          const x = corner[0] + (data.end[j][0] - corner[0]) * t, y = corner[1] + (data.end[j][1] - corner[1]) * t;
          return [0, 1, 2].map(c => ring[c] + ring[3 + c] * x + ring[6 + c] * y + (move ? shift(i, c) : 0));
        });
      });
    }
    function draw() {
      const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth || 900, height = width * 480 / 900;
      canvas.width = width * ratio;
      canvas.height = height * ratio;
      paper.setTransform(ratio, 0, 0, ratio, width * ratio / 2, height * ratio / 2);
      paper.clearRect(-width, -height, 2 * width, 2 * height);
      const [ct, st, ci, si] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
      const seen = p => {
        const u = ct * p[0] + st * p[1], v = -st * p[0] + ct * p[1];
        return [u, -(p[2] * ci + v * si), v * ci - p[2] * si];
      };
      const bodies = [];
      for (const which of ["before", "after"]) if (show[which] && data[which]) bodies.push([which, rings(which).map(r => r.map(seen))]);
      let span = [1e-9, 1e-9];
      for (const r of rings("before")) for (const p of r) {
        const [x, y] = seen(p);
        span = [Math.max(span[0], Math.abs(x)), Math.max(span[1], Math.abs(y))];
      }
      const scale = zoom * Math.min(width / 2 / span[0], height / 2 / span[1]) * 0.86;
      const faces = [];
      for (const [which, tube] of bodies) for (let i = 0; i < tube.length; i++) {
        const ring = tube[i];
        if (i === 0 || i === last) faces.push([which, ring]);
        if (i < last) for (let j = 0; j < ring.length; j++) {
          const k = (j + 1) % ring.length;
          faces.push([which, [ring[j], ring[k], tube[i + 1][k], tube[i + 1][j]]]);
        }
      }
      const depth = face => face[1].reduce((sum, p) => sum + p[2], 0) / face[1].length;
      faces.sort((a, b) => depth(b) - depth(a));
      paper.lineWidth = 0.6;
      for (const [which, face] of faces) {
        paper.beginPath();
        face.forEach((p, i) => i ? paper.lineTo(p[0] * scale, p[1] * scale) : paper.moveTo(p[0] * scale, p[1] * scale));
        paper.closePath();
        paper.fillStyle = which === "before" ? "rgba(140,148,158,0.16)" : "rgba(53,178,74,0.30)";
        paper.strokeStyle = which === "before" ? "rgba(100,108,118,0.55)" : "rgba(23,110,50,0.65)";
        paper.fill();
        paper.stroke();
      }
      if (show.points && points.length) {
        const size = Math.max(1.2, width / 600), move = [0, 0, 0];
        for (let i = 0; i < along.length; i++) {
          if (times > 1 && data.after) {
            const at = along[i] / 65535 * last, k = Math.min(Math.floor(at), last - 1), t = at - k;
            for (let c = 0; c < 3; c++) move[c] = shift(k, c) * (1 - t) + shift(k + 1, c) * t;
          }
          const [x, y] = seen([0, 1, 2].map(c => points[3 * i + c] * data.scale + move[c]));
          paper.fillStyle = COLOURS[far[i] >> 4];
          paper.fillRect(x * scale - size / 2, y * scale - size / 2, size, size);
        }
      }
    }
    let from = null;
    const spread = new Map();
    canvas.addEventListener("pointerdown", event => {
      spread.set(event.pointerId, event);
      from = event;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", event => {
      if (!spread.has(event.pointerId)) return;
      if (spread.size === 2) {
        const gap = () => { const [a, b] = [...spread.values()]; return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY); };
        const before = gap();
        spread.set(event.pointerId, event);
        zoom *= gap() / Math.max(before, 1);
      } else {
        turn += (event.clientX - from.clientX) / 150;
        tilt = Math.max(-1.57, Math.min(1.57, tilt + (event.clientY - from.clientY) / 150));
        spread.set(event.pointerId, event);
      }
      from = event;
      draw();
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, event => spread.delete(event.pointerId));
    canvas.addEventListener("wheel", event => {
      if (document.activeElement !== canvas) return;  // a page that is scrolled must not stop at the view
      event.preventDefault();
      zoom *= Math.exp(-event.deltaY / 500);
      draw();
    }, { passive: false });
    const keys = { ArrowLeft: () => { turn -= 0.1; }, ArrowRight: () => { turn += 0.1; }, ArrowUp: () => { tilt += 0.1; },
      ArrowDown: () => { tilt -= 0.1; }, "+": () => { zoom *= 1.15; }, "-": () => { zoom /= 1.15; } };
    canvas.addEventListener("keydown", event => {
      if (!keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
      draw();
    });
    box.querySelectorAll("[data-show]").forEach(tick => tick.addEventListener("change", () => {
      show[tick.dataset.show] = tick.checked;
      draw();
    }));
    box.querySelector("[data-times]").addEventListener("change", event => {
      times = Number(event.target.value);
      draw();
    });
    return { draw };
  }
  if (rows.length === 1 && !location.hash) history.replaceState(null, "", "#/" + encodeURIComponent(articles[0].dataset.key));
  route();
})();
