// What the page knows beside meshcat: a legend that changes while one looks, and a slider through the iterations.
(() => {
  // A member as long as the view shows at the eye's distance (viewer_camera.py: EYE_SHARE of its length), and an eighth beside it.
  const ASPECT = 1.13;
  const caption = document.getElementById("caption"), player = document.getElementById("player");
  const slider = player.querySelector("input[type=range]"), button = player.querySelector("button"), label = player.querySelector("output");
  const asked = player.querySelector("label"), pairs = asked.querySelector("input");
  const legend = document.getElementById("legend"), heading = legend.querySelector("summary");
  let labels = [], fps = 12;
  // On a phone the legend would hide what it explains: it opens at a touch.
  if (matchMedia("(max-width: 600px)").matches) legend.open = false;
  const own = {
    captions(command) {
      // The heading says the status: below it only the reasons are left.
      const said = ([colour, text]) => [colour, text.startsWith("status: ") ? text.split("\n").slice(1).join("\n") : text];
      caption.replaceChildren(...command.lines.map(said).filter(([, text]) => text).flatMap(([colour, text], i) => {
        const mark = document.createElement("i");
        mark.style.background = colour;
        return [i ? "\n" : "", ...(colour ? [mark] : []), text];
      }));
      const status = command.lines.map(([, text]) => text.split("\n")[0]).find(text => text.startsWith("status: "));
      heading.textContent = status ? `Legend; ${status}` : "Legend";
    },
    // While a fit runs: no steps yet, and pairs where they are asked for.
    live(command) {
      live = true;
      pairs.checked = command.pairs;
      asked.hidden = player.hidden = false;
      steps.forEach(part => { part.hidden = true; });
      ask();
    },
    steps(command) {
      live = false;
      steps.forEach(part => { part.hidden = false; });
      labels = command.labels;
      fps = command.fps;
      slider.max = labels.length - 1;
      player.hidden = labels.length < 2 && !command.pairs;
      asked.hidden = !command.pairs;
      show(labels.length - 1);
    },
  };
  const meshcat = viewer.handle_command.bind(viewer);
  viewer.handle_command = command => (own[command.type] || meshcat)(command);

  const steps = [slider, button, label];
  let live = false;
  function ask() {
    viewer.scene_tree.find(["meshcat", "pairs"]).object.visible = pairs.checked;
    viewer.set_dirty();
    const connection = viewer.connection, say = () => connection.send(pairs.checked ? "pairs" : "no pairs");
    if (connection?.readyState === WebSocket.OPEN) say();
    else connection?.addEventListener("open", say, { once: true });
  }
  // The camera's angle is that of the page's height: on a narrow page a lying member would reach past its sides.
  function fit() {
    const camera = viewer.camera;
    if (!camera?.isPerspectiveCamera) return;
    camera.zoom = Math.min(1, ASPECT * innerWidth / innerHeight);
    camera.updateProjectionMatrix();
    viewer.set_dirty();
  }
  addEventListener("resize", fit);

  function show(step) {
    slider.value = step;
    label.textContent = labels[step];
    slider.setAttribute("aria-valuetext", labels[step]);
    showPairs();
  }
  // Each step has its own lines from scan points to the surface, below pairs/<step>.
  function showPairs() {
    if (asked.hidden || live) return;
    viewer.scene_tree.find(["meshcat", "pairs"]).object.visible = pairs.checked;
    labels.forEach((_, i) => {
      viewer.scene_tree.find(["meshcat", "pairs", String(i)]).object.visible = i === Number(slider.value);
    });
    viewer.set_dirty();
  }
  pairs.addEventListener("change", () => live ? ask() : showPairs());
  slider.addEventListener("input", () => {
    if (viewer.animator.playing) viewer.animator.pause();
    viewer.animator.seek(Number(slider.value) / fps);
    show(Number(slider.value));
  });
  button.addEventListener("click", () => {
    const animator = viewer.animator;
    if (animator.playing) {
      animator.pause();
    } else {
      const atEnd = Number(slider.value) >= labels.length - 1;
      animator.play();
      animator.seek(atEnd ? 0 : Number(slider.value) / fps);
    }
  });
  let played = false;
  function follow() {
    const last = labels.length - 1;
    if (viewer.animator.playing && labels.length) {
      show(Math.max(0, Math.min(last, Math.round(viewer.animator.time * fps))));
    } else if (played && Number(slider.value) > last - fps / 2) {
      show(last);  // played to its end, where frames may have been skipped
    }
    played = viewer.animator.playing;
    button.textContent = viewer.animator.playing ? "Pause" : "Play";
    requestAnimationFrame(follow);
  }
  follow();
  fit();
})();
