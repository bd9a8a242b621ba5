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
