// What the page knows, as signals: the newest of each part, how old it is by now, the connection, and who we are.
import { computed, signal } from "@preact/signals";
import type { DrivePart, Holder, MapPart, Me, MessagePart, Part, RecentPart, Role, ScenePart, SensorsPart, Shown, SystemPart } from "./protocol";
import { type Plain, t } from "./words";

/** The page's clock, ms, that only grows. */
export const clock = (): number => performance.now();

/** The newest of each part; null until one has come. */
export const scene = signal<ScenePart | null>(null);
export const drive = signal<DrivePart | null>(null);
export const sensors = signal<SensorsPart | null>(null);
export const map = signal<MapPart | null>(null);
export const system = signal<SystemPart | null>(null);
/** The newest message that came of a watched channel; `watch` in connection/view.ts says which are wanted. */
export const message = signal<MessagePart | null>(null);
/** The latest messages, while they are watched. */
export const recent = signal<RecentPart | null>(null);

/** The page's clock, ms; five times a second. Read it where something ages by itself. */
export const now = signal(clock());

/** How often each part comes, s: no value in it is newer than that. */
const EVERY: Record<Part["part"], number> = { scene: 0, drive: 0.1, sensors: 0.2, map: 5, system: 1, message: 0, recent: 0.5 };

/** What the way through the network may add, s, before a value counts as old. */
const NETWORK = 0.2;

/** When the robot's part or value came, on the page's clock, and how often it comes, s. */
const arrivals = new WeakMap<object, { at: number; every: number }>();

/** Takes a part in: notes when it and each of its values came, and shows it. */
export function receive(part: Part): void {
  const arrival = { at: clock(), every: EVERY[part.part] };
  arrivals.set(part, arrival);
  for (const field of Object.values(part)) {
    for (const each of Array.isArray(field) ? field : [field]) {
      if (each !== null && typeof each === "object" && "freshness" in each) arrivals.set(each, arrival);
    }
  }
  switch (part.part) {
    case "scene":
      scene.value = part;
      break;
    case "drive":
      drive.value = part;
      break;
    case "sensors":
      sensors.value = part;
      break;
    case "map":
      map.value = part;
      break;
    case "system":
      system.value = part;
      break;
    case "message":
      message.value = part;
      break;
    case "recent":
      recent.value = part;
      break;
  }
}

/** s since `part`, or one of its values, came here. Grows by itself. */
export function since(part: object): number {
  const arrival = arrivals.get(part);
  return arrival === undefined ? 0 : Math.max(0, now.value - arrival.at) / 1000;
}

/** s since a value was heard on the bus; null: never. Grows by itself. */
export function age(shown: Shown<unknown>): number | null {
  return shown.age === null ? null : shown.age + since(shown);
}

/** Never heard, or older than twice its period, or the connection is lost. Grows stale by itself. */
export function stale(shown: Shown<unknown> | null | undefined): boolean {
  if (!shown || shown.value === null || shown.freshness === "never") return true;
  if (shown.freshness === "stale" || connection.value.state === "lost") return true;
  // Until the next part comes nothing newer can be known of it.
  const every = arrivals.get(shown)?.every ?? 0;
  return (age(shown) ?? Infinity) > 2 * (shown.period ?? Infinity) + every + NETWORK;
}

/** A value that may be relied on now; null where it is stale. */
export function fresh<T>(shown: Shown<T> | null | undefined): T | null {
  return shown && !stale(shown) ? shown.value : null;
}

// -------------------------------------------------------------------------------------------------- the connection

/** Longer, and a round trip is called slow; longer still, and nobody drives over it. ms. */
export const SLOW = 200;
export const TOO_SLOW = 500;
/** So long without a `drive` part or an answer to a ping, and the connection is lost: with the page's own tick, said within 1 s. ms. */
export const LOST = 800;

/** One of the two sockets. */
export interface Link {
  open: boolean;
  /** When something was last heard on it, ms; null: never since it was opened. */
  heard: number | null;
  /** Why it was closed, in words; empty: not known. */
  why: string;
}
export const viewLink = signal<Link>({ open: false, heard: null, why: "" });
export const commandLink = signal<Link>({ open: false, heard: null, why: "" });
/** The last round trip, or how long an answer is overdue already, ms; null: none yet. */
export const roundTrip = signal<number | null>(null);

export type Connection =
  | { state: "connecting"; why: string }
  | { state: "live"; quality: "good" | "slow" | "bad" }
  /** `for`: s. */
  | { state: "lost"; why: string; for: number };

/** The address asks for a recorded run: then there are no commands, and no socket for them. */
export const recorded = new URLSearchParams(globalThis.location?.search ?? "").has("demo");

/** Something was shown already: from then on its absence is a loss. */
const begun = computed(() => drive.value !== null);

export const connection = computed<Connection>(() => {
  const view = viewLink.value;
  const command = commandLink.value;
  const why = view.why || command.why;
  if (!begun.value) return { state: "connecting", why };
  const heard = drive.value ? since(drive.value) * 1000 : Infinity;
  const trip = roundTrip.value ?? 0;
  if (!view.open || heard > LOST) return { state: "lost", why, for: heard / 1000 };
  if (!recorded && (!command.open || trip > LOST)) return { state: "lost", why: command.why || "commands are not answered", for: trip / 1000 };
  return { state: "live", quality: trip > TOO_SLOW ? "bad" : trip > SLOW ? "slow" : "good" };
});

// -------------------------------------------------------------------------------------------------- who we are

export const me = signal<Me | null>(null);

const RANK: Record<Role, number> = { nobody: 0, viewer: 1, operator: 2, engineer: 3 };

/** What is shown of the robot is a recorded run. */
export const demo = computed(() => scene.value?.demo ?? null);
export const role = computed<Role>(() => me.value?.role ?? "nobody");
/** Whether we may do what `needs` that role. Never in a recorded run. */
export const may = (needs: Role): boolean => RANK[role.value] >= RANK[needs] && (RANK[needs] < 2 || demo.value === null);

/** The motion authority, as the command socket said it last. */
export const authority = signal<{ holder: Holder | null; yours: boolean }>({ holder: null, yours: false });
/** Our number among the command sockets; null: not welcomed yet. */
export const ourId = signal<number | null>(null);

/** Who holds it: what the command socket says, else what the view shows. */
export const holder = computed<Holder | null>(() => {
  const seen = drive.value?.holder ?? null;
  const told = authority.value.holder;
  // Whether it drives, and since when, the view says each time.
  return !commandLink.value.open || (seen !== null && seen.id === told?.id) ? seen : told;
});

/** Control is all that is missing, and it is free. */
export const UNHELD: Plain = "Nobody has control. Take control first.";

/** Why nothing can be commanded now that needs the authority; null: it can. */
export const whyNot = computed<string | null>(() => {
  if (demo.value) return t("This is a recorded run: nothing can be commanded.");
  if (!may("operator")) return t("You are watching. To drive, pair this device with the code from the robot's console.");
  if (connection.value.state !== "live") return t("There is no connection to the robot.");
  if (!authority.value.yours) {
    return holder.value ? t("{name} has control.", { name: holder.value.name }) : t(UNHELD);
  }
  return null;
});

/** Lets values grow older. Called once. */
export function tick(): void {
  setInterval(() => (now.value = clock()), 200);
}
