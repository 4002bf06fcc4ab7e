/** All that is known of the fleet: the newest of every part, put together from the states that came. */

/** @typedef {import("./protocol.js").Hello} Hello */
/** @typedef {import("./protocol.js").State} State */
/** @typedef {import("./protocol.js").Details} Details */
/** @typedef {import("./protocol.js").Condition} Condition */
/** @typedef {import("./protocol.js").RobotFacts} RobotFacts */

const MOST_EVENTS = 100;

/** @type {Details} */
const NOTHING = {
  state: "unseen",
  reason: "",
  note: "",
  complaints: [],
  pose_age: null,
  latency: null,
  cal: [null, null],
  wheels: "",
  behaviour: null,
  parameters: {},
  path: null,
  cell: null,
  goal: null,
};

/** One robot of the fleet file. */
export class Robot {
  /** Where it was last seen [m, rad]; meaningless unless `placed`. */
  x = 0;
  y = 0;
  theta = 0;
  /** Whether it was ever seen. */
  placed = false;
  /** @type {number | null} [m/s] */
  v = null;
  /** @type {number | null} [rad/s] */
  omega = null;
  /** @type {number | null} of its place [s] */
  age = null;
  /** @type {[number | null, number | null]} the newest command [m/s, rad/s] */
  command = [null, null];
  details = NOTHING;

  /**
   * @param {string} name
   * @param {RobotFacts} facts
   */
  constructor(name, facts) {
    this.name = name;
    this.facts = facts;
  }

  /** @returns {Condition} the word that decides its shape and colour. */
  get condition() {
    return this.details.state;
  }

  /** @param {import("./protocol.js").Row} row */
  take([x, y, theta, v, omega, age, commandedSpeed, commandedTurning]) {
    this.placed = x !== null && y !== null;
    this.x = x ?? 0;
    this.y = y ?? 0;
    this.theta = theta ?? 0;
    this.v = v;
    this.omega = omega;
    this.age = age;
    this.command = [commandedSpeed, commandedTurning];
  }
}

export class Fleet {
  /** @type {Hello | null} */
  hello = null;
  /** @type {State | null} the newest, as it came. */
  state = null;
  /** @type {Map<string, Robot>} in the order of the fleet file. */
  robots = new Map();
  /** @type {import("./protocol.js").Circle | null} */
  circle = null;
  /** @type {Record<string, number>} */
  gaps = {};
  stop = { all: false, names: /** @type {string[]} */ ([]), revision: 0 };
  /** @type {NonNullable<State["lease"]>} */
  leases = [];
  /** @type {NonNullable<State["processes"]>} */
  processes = {};
  /** @type {import("./protocol.js").Event[]} the newest first. */
  events = [];
  /** What was broken in this run, as rows of a scenario, and what still is. @type {NonNullable<State["faults"]>} */
  faults = { rows: "", lasting: [] };

  /** @param {Hello} hello */
  greet(hello) {
    this.hello = hello;
    const before = this.robots;
    this.robots = new Map();
    for (const [name, facts] of Object.entries(hello.robots)) {
      const robot = before.get(name) ?? new Robot(name, facts);
      robot.facts = facts;
      this.robots.set(name, robot);
    }
  }

  /** @param {State} state */
  take(state) {
    this.state = state;
    for (const [name, row] of Object.entries(state.robots)) this.robots.get(name)?.take(row);
    for (const [name, details] of Object.entries(state.details ?? {})) {
      const robot = this.robots.get(name);
      if (robot !== undefined) robot.details = details;
    }
    if (state.circle !== undefined) this.circle = state.circle;
    this.gaps = state.gaps ?? this.gaps;
    this.stop = state.stop ?? this.stop;
    this.leases = state.lease ?? this.leases;
    this.processes = state.processes ?? this.processes;
    this.faults = state.faults ?? this.faults;
    if (state.events?.length) {
      const known = this.events[0]?.[0] ?? -1;
      // A base station that was restarted counts from the beginning.
      const kept = state.events.some(([number]) => number <= known) ? [] : this.events;
      this.events = [...[...state.events].reverse(), ...kept].slice(0, MOST_EVENTS);
    }
  }

  /** Whether this page may give orders. */
  get maySteer() {
    return this.hello?.may_steer ?? false;
  }

  /**
   * Whether a behaviour needs an input.
   *
   * @param {string | null} behaviour
   * @param {string} input  such as "goal".
   */
  needs(behaviour, input) {
    return this.hello?.behaviours[behaviour ?? ""]?.needs.includes(input) ?? false;
  }

  /** The first behaviour that needs an input; empty for none. @param {string} input */
  needing(input) {
    return Object.keys(this.hello?.behaviours ?? {}).find((behaviour) => this.needs(behaviour, input)) ?? "";
  }

  /** Whether a robot has been stopped. @param {string} name */
  isStopped(name) {
    return this.stop.all || this.stop.names.includes(name);
  }
}
