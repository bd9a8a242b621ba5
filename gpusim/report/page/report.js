// Before/after slider. Without this script both images stand side by side.
for (const figure of document.querySelectorAll("[data-compare]")) {
  const view = figure.querySelector(".view");
  const range = figure.querySelector("input");
  const blink = figure.querySelector("[data-blink]");
  let timer = 0;

  const show = (percent) => view.style.setProperty("--split", `${percent}%`);
  const stop = () => {
    clearInterval(timer);
    timer = 0;
    view.classList.remove("blinking");
    blink.setAttribute("aria-pressed", "false");
    show(range.value);
  };

  range.addEventListener("input", stop);
  blink.addEventListener("click", () => {
    if (timer) return stop();
    let reference = false;
    view.classList.add("blinking");
    blink.setAttribute("aria-pressed", "true");
    timer = setInterval(() => {
      reference = !reference;
      show(reference ? 100 : 0);
    }, 600);
  });
  show(range.value);
}

// Sliders over frames. Without this script, and on paper, the last frame is shown.
for (const figure of document.querySelectorAll("[data-slides]")) {
  const slides = [...figure.querySelectorAll("a")];
  const range = figure.querySelector("input");
  const play = figure.querySelector("[data-play]");
  const label = figure.querySelector("output");
  let timer = 0;

  const show = (number) => {
    slides.forEach((slide, k) => slide.classList.toggle("shown", k === number));
    label.textContent = slides[number].dataset.label;
    range.value = number;
  };
  const stop = () => {
    clearInterval(timer);
    timer = 0;
    play.setAttribute("aria-pressed", "false");
  };

  range.addEventListener("input", () => {
    stop();
    show(Number(range.value));
  });
  play.addEventListener("click", () => {
    if (timer) return stop();
    play.setAttribute("aria-pressed", "true");
    timer = setInterval(() => show((Number(range.value) + 1) % slides.length), 300);
  });
}

// A click on a picture shows it as large as it is; Escape closes it. Without this script the link
// opens the file.
const large = document.getElementById("large");
for (const link of document.querySelectorAll(".plot a")) {
  link.addEventListener("click", (event) => {
    const image = link.querySelector("img");
    if (event.ctrlKey || event.metaKey || event.shiftKey || !image) return;
    event.preventDefault();
    const shown = large.querySelector("img");
    shown.src = image.src;
    shown.alt = image.alt;
    shown.className = image.className;
    large.querySelector("span").textContent = image.alt;
    large.querySelector("a").href = link.href;
    large.showModal();
  });
}
large.addEventListener("click", (event) => {
  if (!event.target.closest("a")) large.close();
});
