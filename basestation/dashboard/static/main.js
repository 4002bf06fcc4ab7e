/** Puts the page together. */

import { Arena } from "./arena.js";
import { BehaviourPanel } from "./behaviour_panel.js";
import { CirclePanel } from "./circle_panel.js";
import { Connection } from "./connection.js";
import { byId, say } from "./dom.js";
import { Driving } from "./driving.js";
import { FaultsPanel } from "./faults_panel.js";
import { Fleet } from "./fleet.js";
import { HealthPanel } from "./health_panel.js";
import { History } from "./history.js";
import { Link } from "./link.js";
import { Orders } from "./orders.js";
import { Palette } from "./palette.js";
import { Pictures } from "./pictures.js";
import { Plots } from "./plots.js";
import { ArenaPointer } from "./pointer.js";
import { RobotCard } from "./robot_card.js";
import { RobotList } from "./robot_list.js";
import { StopDesk } from "./stop.js";
import { Tabs } from "./tabs.js";
import { Theme } from "./theme.js";
import { messagePack, uPlot } from "./vendor.js";
import { clock } from "./words.js";

/** Words and figures are shown no more often [ms]: nobody can read faster. */
const READING = 200;

/** @param {string} id */
const at = (id) => byId(id, HTMLElement);

function start() {
  if (messagePack === null || uPlot === null) {
    say(
      at("veil-words"),
      "The page's libraries are missing. In a clone of the project run `make setup`; a wheel without them is broken: " +
        "install another one. Until then use `muro stop` and the other commands.",
    );
    at("veil").hidden = false;
    say(at("link-words"), "Not working");
    // What looks alive and is not would be pressed in an emergency.
    const stop = byId("stop", HTMLButtonElement);
    stop.disabled = true;
    say(stop, "Stop does not work here");
    at("desk").inert = true;
    return;
  }
  const fleet = new Fleet();
  const history = new History();
  const token = new URLSearchParams(location.hash.slice(1)).get("token") ?? "";
  const address = `${location.origin.replace(/^http/, "ws")}/ws`;
  const connection = new Connection(address, token, receive, changed);
  const orders = new Orders(connection, at("notices"));
  const stop = new StopDesk(
    { button: at("stop"), receipt: at("receipt"), resume: at("resume") },
    connection,
    fleet,
    orders,
    () => driving.letGo(),
  );
  new Theme(at("theme"), recolour);
  const palette = new Palette();
  const pictures = new Pictures(connection, () => arena.redraw());
  const arena = new Arena(byId("floor", HTMLCanvasElement), fleet, palette, pictures);
  const link = new Link(
    { words: at("link-words"), age: at("link-age"), veil: at("veil"), why: at("veil-words"), more: at("veil-age") },
    connection,
  );
  const driving = new Driving(connection, fleet, {
    changed: () => card.showWish(),
    released: () => card.releaseStick(),
  });
  const card = new RobotCard(at("card"), arena, orders, driving, stop);
  const list = new RobotList(at("robots"), at("aside"), fleet, choose);
  const behaviours = new BehaviourPanel(at("panel-behaviour"), fleet, orders);
  const circle = new CirclePanel(at("panel-behaviour"), arena, orders);
  const plots = new Plots(at("panel-plots"), fleet, history, palette);
  const health = new HealthPanel(at("panel-health"), fleet);
  const faults = new FaultsPanel(at("panel-faults"), fleet, orders);
  new Tabs(at("tabs"), show);
  new ArenaPointer(arena, {
    choose,
    maySetGoal,
    setGoal: (x, y, theta) => card.sendTo(x, y, theta),
    moveCircle: (moved) => circle.give(moved),
  });
  look(arena, async () => {
    const on = !pictures.on;
    at("pictures").ariaPressed = String(on);
    const replies = await askForPictures(on);
    const worst = replies.find(({ outcome }) => outcome !== "taken") ?? replies[0];
    const none = { outcome: /** @type {const} */ ("refused"), reason: "there are no cameras" };
    orders.notice(`Pictures of the cameras ${on ? "on" : "off"}`, worst ?? none);
  });
  setInterval(show, READING);
  window.addEventListener("hashchange", () => location.reload()); // another token

  /** @param {import("./protocol.js").Message} message */
  function receive(message) {
    if (message.kind === "hello") {
      fleet.greet(message);
      arena.view.showArena(message.arena);
      at("tab-faults").hidden = !message.simulated;
      say(at("where"), [message.scenario, message.realm].filter(Boolean).join(" · "));
      if (pictures.on) void askForPictures(true);
      show();
    } else if (message.kind === "state") {
      fleet.take(message);
      history.take(fleet);
      arena.take(message.t);
    } else if (message.kind === "picture") {
      void pictures.take(message);
    } else if (message.order === "drive") {
      orders.notice(`Drive ${driving.name}`, message); // answered only when it is refused
    } else {
      orders.notice(message.order ? `A late answer to ${message.order}` : "A message", message);
    }
  }

  /** @param {boolean} on */
  function askForPictures(on) {
    return pictures.want(Object.keys(fleet.hello?.cameras ?? {}), on, fleet.state?.t ?? 0);
  }

  /** @param {boolean} open */
  function changed(open) {
    if (open) stop.connected();
    else driving.letGo();
    show();
  }

  /** Choose a robot; the one that is chosen is chosen no longer. @param {string} name */
  function choose(name) {
    arena.selected = name === arena.selected ? "" : name;
    if (arena.selected !== driving.name) driving.take(""); // nobody drives what is not shown to be driven
    arena.redraw();
    show();
  }

  function maySetGoal() {
    return fleet.maySteer && card.robot !== undefined && driving.name === "";
  }

  function recolour() {
    palette.read();
    arena.redraw();
    plots.update();
  }

  function show() {
    const live = link.update(fleet.processes.router?.alive ?? true);
    stop.update();
    list.update(arena.selected);
    card.update();
    behaviours.update();
    circle.update();
    if (live) plots.update();
    health.update(live);
    faults.update();
    say(
      at("held"),
      fleet.leases
        .map(({ program, operator, since }) => `held by ${program} of ${operator} since ${clock(since)}`)
        .join("; "),
    );
    say(at("hint"), hint());
    say(at("silent"), pictures.silent(fleet.state?.t ?? 0).join("; "));
    arena.canvas.classList.toggle("aiming", maySetGoal());
    document.body.dataset.driving = driving.name;
  }

  /** What a click on the floor would do. */
  function hint() {
    if (arena.circle !== null) return "Drag the middle of the circle, or its rim.";
    if (driving.name) return `Driving ${driving.name} by hand.`;
    if (arena.selected && fleet.maySteer) return `Click the floor to send ${arena.selected} there; drag for a heading.`;
    return "";
  }

  // For tests: what is where, and what was sent. Nothing of the page can be changed by it.
  Object.defineProperty(window, "muro", {
    value: Object.freeze({
      /** @param {string} name */
      screenOf: (name) => arena.screenOf(name),
      /** @param {number} x @param {number} y */
      screenAt: (x, y) => [arena.view.px(x), arena.view.py(y)],
      /** @param {string} name */
      conditionOf: (name) => fleet.robots.get(name)?.condition ?? null,
      get sent() {
        return connection.sent;
      },
      get connected() {
        return connection.open;
      },
      get state() {
        return structuredClone(fleet.state);
      },
      get times() {
        return [...arena.times];
      },
    }),
  });
}

/**
 * The buttons that change how the arena is looked at.
 *
 * @param {Arena} arena
 * @param {() => void} switchPictures  on or off.
 */
function look(arena, switchPictures) {
  /** @param {string} id @param {() => void} does */
  const on = (id, does) => {
    at(id).onclick = () => {
      does();
      arena.redraw();
    };
  };
  on("zoom-in", () => arena.view.zoom(1.4));
  on("zoom-out", () => arena.view.zoom(1 / 1.4));
  on("all", () => arena.view.fit());
  on("pictures", switchPictures);
}

start();
