/** A thumb-stick: forwards is up, and to the left is to the left. It springs back. */

/** Near its middle it says nothing [fraction of its reach]. */
const DEAD = 0.12;

export class Stick {
  /** The finger that moves it. @type {number | null} */
  #finger = null;

  /**
   * @param {HTMLElement} pad  in which the knob moves.
   * @param {HTMLElement} knob
   * @param {(forwards: number, left: number) => void} moved  in [-1, 1].
   */
  constructor(pad, knob, moved) {
    this.pad = pad;
    this.knob = knob;
    this.moved = moved;
    pad.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      this.#finger = event.pointerId;
      pad.setPointerCapture(event.pointerId);
      this.#follow(event);
    });
    // A finger that rests on it asks for no menu, which would take the hand off.
    pad.addEventListener("contextmenu", (event) => {
      event.preventDefault();
      event.stopPropagation();
    });
    pad.addEventListener("pointermove", (event) => this.#follow(event));
    for (const kind of /** @type {const} */ (["pointerup", "pointercancel", "lostpointercapture"])) {
      pad.addEventListener(kind, (event) => {
        if (event.pointerId !== this.#finger) return;
        this.#finger = null;
        moved(0, 0);
      });
    }
  }

  /** Follow the finger that is on it no longer: it must come anew. */
  release() {
    const finger = this.#finger;
    this.#finger = null;
    if (finger !== null && this.pad.hasPointerCapture(finger)) this.pad.releasePointerCapture(finger);
  }

  /**
   * Show what is wished, by whatever hand.
   *
   * @param {[number, number]} wish
   */
  show([forwards, left]) {
    const reach = this.pad.clientWidth / 2 - this.knob.clientWidth / 2;
    this.knob.style.transform = `translate(${-left * reach}px, ${-forwards * reach}px)`;
  }

  /** @param {PointerEvent} event */
  #follow(event) {
    if (event.pointerId !== this.#finger) return;
    const box = this.pad.getBoundingClientRect();
    const reach = box.width / 2 - this.knob.clientWidth / 2;
    const left = (box.left + box.width / 2 - event.clientX) / reach;
    const forwards = (box.top + box.height / 2 - event.clientY) / reach;
    const size = Math.hypot(left, forwards);
    if (size < DEAD) return this.moved(0, 0);
    const scale = 1 / Math.max(1, size);
    this.moved(forwards * scale, left * scale);
  }
}
