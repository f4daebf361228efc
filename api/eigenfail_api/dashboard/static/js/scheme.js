// The theme that the user chose, in place of the system's. It runs before the page is painted.
(() => {
  const root = document.documentElement;
  const known = ["light", "dark"];
  const recall = () => { try { return localStorage.getItem("scheme"); } catch { return null; } };
  const keep = (scheme) => { try { localStorage.setItem("scheme", scheme); } catch { /* of this page alone */ } };
  if (known.includes(recall())) root.dataset.scheme = recall();
  document.addEventListener("click", ({ target }) => {
    if (!target.closest("[data-switch-scheme]")) return;
    const system = window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
    root.dataset.scheme = known.find((scheme) => scheme !== (root.dataset.scheme ?? system));
    keep(root.dataset.scheme);
    window.dispatchEvent(new Event("eigenfail:scheme"));
  });
})();
