/* What is set in a place: one state, the actions on it, and what undo and redo go back and forth
   between. What is drawn follows from the state; the address mirrors it, a reload restores it. */
import { el, symbol } from "./page.js";

const MOST_STEPS = 300;
const MOST_CHARACTERS = 40_000_000; // of all kept states together: painted maps are long
// characters of one place over a reload: a browser keeps some millions
const MOST_SAVED = 1_500_000;

/** A state is what JSON can hold: all that is set, and nothing that follows from it. Beside it is
 *  what is looked at (the tab, the episode on the stage), which undo leaves as it is. */
export class Store {
  /** `restore(state)` sets all that is set, at once. */
  constructor(restore) {
    this.restore = restore;
    this.text = null;
    this.done = [];
    this.undone = [];
    this.gesture = null;
    this.restoring = false;
    /** @type {Record<string, any>} */
    this.view = {};
    this.listeners = new Set();
  }

  /** The state; null before the first action. */
  get state() {
    return JSON.parse(this.text);
  }

  /** Call `tell()` after each change; returns what ends it. */
  subscribe(tell) {
    this.listeners.add(tell);
    return () => this.listeners.delete(tell);
  }

  tell() {
    this.listeners.forEach((tell) => tell());
  }

  /** An action led to this state. What one gesture does, such as typing in one field, is one
   *  step. */
  act(state, gesture = null) {
    const text = JSON.stringify(state);
    if (this.restoring || this.text === null) this.text = text;
    if (text !== this.text) {
      const goesOn = gesture !== null && gesture === this.gesture;
      if (!goesOn) this.done.push(this.text);
      else if (this.done.at(-1) === text) this.done.pop(); // typed, and deleted again
      this.text = text;
      this.gesture = this.done.length ? gesture : null;
      this.undone = [];
      let length = this.done.reduce((sum, one) => sum + one.length, 0);
      while (length > MOST_CHARACTERS || this.done.length > MOST_STEPS) {
        length -= this.done.shift().length;
      }
    }
    this.tell();
  }

  /** The state has another form, although nothing was done: what was painted is a file now. */
  amend(state) {
    this.text = JSON.stringify(state);
    this.tell();
  }

  /** Forget the last steps as long as `part(state)` holds: they are parts of the next one. */
  fold(part) {
    while (this.done.length && part(this.state)) this.text = this.done.pop();
  }

  /** The gesture has ended: the same one is a new step. */
  end() {
    this.gesture = null;
  }

  undo() {
    this.step(this.done, this.undone);
  }

  redo() {
    this.step(this.undone, this.done);
  }

  step(from, to) {
    if (!from.length) return;
    to.push(this.text);
    this.enter(from.pop());
  }

  enter(text) {
    this.text = text;
    this.gesture = null;
    this.restoring = true;
    try {
      this.restore(this.state);
    } finally {
      this.restoring = false;
      this.tell();
    }
  }

  /** Look at something else: no step, but a reload shows it again. */
  look(changes) {
    Object.assign(this.view, changes);
  }

  /** All of it, as far as it has room: the newest steps first. */
  saved() {
    let room = MOST_SAVED - (this.text?.length ?? 0);
    const newest = (steps) =>
      steps.slice(steps.findLastIndex((one) => (room -= one.length) < 0) + 1);
    return {
      text: this.text,
      done: newest(this.done),
      undone: newest(this.undone),
      view: this.view,
    };
  }

  revive({ text, done, undone, view }) {
    Object.assign(this, { done, undone, view });
    this.enter(text);
  }
}

/** The buttons of undo and redo. */
export function stepButtons(store) {
  const button = (word, key, path, act) =>
    el(
      "button.tool",
      {
        type: "button",
        disabled: true,
        title: `${word} (${key})`,
        "aria-label": word,
        onclick: act,
      },
      symbol(path),
    );
  const back = button("Undo", "Ctrl Z", "M9 5L4 10l5 5M4 10h10a5 5 0 0 1 0 10h-3", () =>
    store.undo(),
  );
  const forth = button("Redo", "Ctrl Shift Z", "M15 5l5 5-5 5M20 10H10a5 5 0 0 0 0 10h3", () =>
    store.redo(),
  );
  store.subscribe(() => {
    back.disabled = !store.done.length;
    forth.disabled = !store.undone.length;
  });
  return el("div.group", {}, back, forth);
}

/** Results belong to the state that they were made from. `current()` is a text of it; as soon as it
 *  is another one, `element` wears a veil, and `tell(fresh)` hears of it: also when undo brings the
 *  state back.
 *
 *  @param {() => string} current
 *  @param {HTMLElement} element
 *  @param {(fresh: boolean) => void} tell */
export function dated(current, element, tell = () => {}) {
  let of = null,
    was = null;
  return {
    get fresh() {
      return was === true;
    },
    get of() {
      return of;
    },
    /** What is shown now was made from the state `text`; null: nothing is shown. */
    is(text) {
      of = text;
      was = null;
      this.refresh();
    },
    refresh() {
      const fresh = of === null ? null : of === current();
      if (fresh === was && of !== null) return;
      was = fresh;
      if (fresh === false) element.dataset.aged = "out of date";
      else delete element.dataset.aged;
      if (fresh !== null) tell(fresh);
    },
  };
}
