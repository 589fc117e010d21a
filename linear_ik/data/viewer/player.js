// What the page knows beside meshcat: a legend that changes while one looks, and a slider through the iterations.
(() => {
  const caption = document.getElementById("caption"), player = document.getElementById("player");
  const slider = player.querySelector("input[type=range]"), button = player.querySelector("button"), label = player.querySelector("output");
  const asked = player.querySelector("label"), pairs = asked.querySelector("input");
  let labels = [], fps = 12;
  const own = {
    captions(command) {
      caption.replaceChildren(...command.lines.flatMap(([colour, text], i) => {
        const mark = document.createElement("i");
        mark.style.background = colour;
        return [i ? "\n" : "", ...(colour ? [mark] : []), text];
      }));
    },
    steps(command) {
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

  function show(step) {
    slider.value = step;
    label.textContent = labels[step];
    slider.setAttribute("aria-valuetext", labels[step]);
    showPairs();
  }
  // Each step has its own lines from scan points to the surface, below pairs/<step>.
  function showPairs() {
    if (asked.hidden) return;
    viewer.scene_tree.find(["meshcat", "pairs"]).object.visible = pairs.checked;
    labels.forEach((_, i) => {
      viewer.scene_tree.find(["meshcat", "pairs", String(i)]).object.visible = i === Number(slider.value);
    });
    viewer.set_dirty();
  }
  pairs.addEventListener("change", showPairs);
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
})();
