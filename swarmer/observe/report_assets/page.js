"use strict";
// The page without this script is whole but for what needs one: choosing the colours, saving figures, the view in space.
(() => {
  const root = document.documentElement;
  root.classList.add("scripted");

  const theme = document.getElementById("theme");
  theme.addEventListener("change", () => {
    if (theme.value === "system") root.removeAttribute("data-theme");
    else root.dataset.theme = theme.value;
    document.dispatchEvent(new Event("swarmer:theme"));
  });

  // A figure on its own has no page around it: its variables become the colours that they have now.
  const standalone = (svg) => {
    const look = getComputedStyle(root);
    const copy = svg.cloneNode(true);
    copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    copy.setAttribute("xmlns:xlink", "http://www.w3.org/1999/xlink");
    copy.style.background = look.getPropertyValue("--card").trim();
    copy.style.color = look.getPropertyValue("--ink").trim();
    return new XMLSerializer().serializeToString(copy)
      .replace(/var\((--[\w-]+)\)/g, (_, name) => look.getPropertyValue(name).trim());
  };

  const save = (text, type, name) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  };

  for (const button of document.querySelectorAll("button[data-svg]")) {
    button.addEventListener("click", () => {
      const svg = document.querySelector(`#${CSS.escape(button.dataset.svg)} svg`);
      save('<?xml version="1.0" encoding="utf-8"?>\n' + standalone(svg), "image/svg+xml", `${button.dataset.svg}.svg`);
    });
  }
})();
