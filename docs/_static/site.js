// What the theme leaves out: levels of the headings beside the text, and blocks of code that scroll by the keyboard.
addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll("p.caption[role=heading]").forEach((e) => e.setAttribute("aria-level", "2"));
  document.querySelectorAll("aside.sidebar-drawer").forEach((e) => e.setAttribute("aria-label", "site"));
  document.querySelectorAll("aside.toc-drawer").forEach((e) => e.setAttribute("aria-label", "this page"));
  document.querySelectorAll(".sphx-glr-thumbcontainer").forEach((e) => {
    const name = e.querySelector(".sphx-glr-thumbnail-title")?.textContent;
    if (name) e.querySelectorAll("a").forEach((link) => link.setAttribute("aria-label", name));
  });
  document.querySelectorAll("pre").forEach((e) => {
    if (e.scrollWidth > e.clientWidth) e.tabIndex = 0;
  });
});
