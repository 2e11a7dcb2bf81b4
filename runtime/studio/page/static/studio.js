"use strict";
/* The page's own elements and events: a place to drop files, and the value to which a control is set. */
(() => {
  document.addEventListener("change", (event) => {
    const from = event.target;
    if (!(from instanceof Element && from.hasAttribute("data-control"))) return;
    const detail = { control: from.getAttribute("data-control"), value: from.value };
    from.dispatchEvent(new CustomEvent("chosen", { detail, bubbles: true }));
  });

  /* A link to a part of the page unfolds it. */
  document.addEventListener("click", (event) => {
    const link = event.target instanceof Element && event.target.closest('a[href^="#"]');
    const part = link && document.getElementById(link.getAttribute("href").slice(1));
    if (part) for (const folded of [part.closest("details"), ...part.querySelectorAll(":scope > details")]) if (folded) folded.open = true;
  });

  /* A section that is drawn again returns the focus to the element that had it. */
  const KEYS = ["data-control", "data-do", "data-step", "data-joint", "data-go"];
  let focused = null;
  document.addEventListener("focusin", (event) => {
    const key = KEYS.find((name) => event.target.hasAttribute(name));
    focused = key ? `[${key}="${CSS.escape(event.target.getAttribute(key))}"]` : null;
  });
  document.addEventListener("pointerdown", () => { focused = null; });
  new MutationObserver(() => {
    if (focused && document.activeElement === document.body) document.querySelector(focused)?.focus({ preventScroll: true });
  }).observe(document.body, { childList: true, subtree: true });

  /* What a place for files says last, by its role: the place is drawn again whenever the inputs change. */
  const said = new Map();

  customElements.define("file-drop", class extends HTMLElement {
    connectedCallback() {
      if (this.firstChild) return;
      const label = document.createElement("label"), input = document.createElement("input"), text = document.createElement("span");
      this.status = document.createElement("p");
      this.status.setAttribute("role", "status");
      Object.assign(input, { type: "file", multiple: !["model", "plan"].includes(this.getAttribute("as")) });
      text.textContent = this.getAttribute("label");
      label.append(text, input);
      this.append(label, this.status);
      this.show(...said.get(this.getAttribute("as")) ?? ["", false]);
      input.addEventListener("change", () => { this.send([...input.files]); input.value = ""; });
      for (const name of ["dragenter", "dragover"]) this.addEventListener(name, (event) => { event.preventDefault(); this.setAttribute("data-over", ""); });
      this.addEventListener("dragleave", () => this.removeAttribute("data-over"));
      this.addEventListener("drop", (event) => {
        event.preventDefault();
        this.removeAttribute("data-over");
        this.send([...event.dataTransfer.files]);
      });
    }

    async send(files) {
      for (const file of files) {
        const waits = document.querySelector("[data-do=cancel]");
        this.say(waits ? `${file.name} is read once the running task has ended …` : `Reading ${file.name} …`);
        const query = new URLSearchParams({ as: this.getAttribute("as"), name: file.name });
        try {
          const answer = await fetch(`/given?${query}`, { method: "POST", body: file, credentials: "same-origin" });
          if (!answer.ok) { this.say((await answer.text()).trim(), true); return; }
        } catch { this.say(`${file.name} could not be sent; is the studio still running?`, true); return; }
      }
      this.say("");
    }

    say(text, wrong = false) {
      const role = this.getAttribute("as");
      said.set(role, [text, wrong]);
      for (const place of document.querySelectorAll(`file-drop[as="${role}"]`)) place.show(text, wrong);
    }

    show(text, wrong) {
      this.status.textContent = text;
      this.status.className = wrong ? "warning" : "of";
    }
  });
})();
