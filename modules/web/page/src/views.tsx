// The views, in the order of the navigation. A panel is a folder of panels/ whose index.tsx exports its view; it is one line here.
import { computed, signal } from "@preact/signals";
import {
  Boxes,
  Bug,
  Cable,
  Gamepad2,
  HardDriveDownload,
  type LucideIcon,
  MapIcon,
  MessagesSquare,
  PlugZap,
  Radar,
  TriangleAlert,
  UsersRound,
} from "lucide-preact";
import type { ComponentType } from "preact";
import { Access } from "./access";
import { Drive } from "./drive";
import { MapView } from "./map";
import { Buses } from "./panels/buses";
import { Errors, standing } from "./panels/errors";
import { Logs } from "./panels/logs";
import { Messages } from "./panels/messages";
import { Modules } from "./panels/modules";
import { Power } from "./panels/power";
import { Sensors } from "./panels/sensors";
import { Simulator } from "./panels/simulator";
import { me, scene } from "./state";
import type { Plain } from "./words";

export interface View {
  /** Its address: `#/id`. */
  id: string;
  label: Plain;
  icon: LucideIcon;
  view: ComponentType;
  /** Whether it is there; without it, always. */
  when?: () => boolean;
  /** For engineers: in English, whatever the language of the page. */
  english?: true;
  /** What the navigation shows beside it: how many errors stand, say. 0: nothing. */
  count?: () => number;
  /** On a phone it stands in the bar at the bottom; the others are under "More". */
  first?: boolean;
}

/** It is simulated: for a view's `when`. */
export const simulated = (): boolean => scene.value?.simulated ?? false;

export const VIEWS: View[] = [
  { id: "drive", label: "Drive", icon: Gamepad2, view: Drive, first: true },
  { id: "map", label: "Map", icon: MapIcon, view: MapView, first: true },
  { id: "modules", label: "Modules", icon: Boxes, view: Modules },
  { id: "errors", label: "Errors", icon: TriangleAlert, view: Errors, count: standing, first: true },
  { id: "sensors", label: "Sensors", icon: Radar, view: Sensors },
  { id: "power", label: "Power", icon: PlugZap, view: Power },
  { id: "buses", label: "Buses", icon: Cable, view: Buses, english: true },
  { id: "messages", label: "Messages", icon: MessagesSquare, view: Messages, english: true },
  { id: "logs", label: "Logs", icon: HardDriveDownload, view: Logs },
  { id: "simulator", label: "Simulator", icon: Bug, view: Simulator, english: true, when: simulated },
  { id: "access", label: "This device", icon: UsersRound, view: Access },
];

/** Those that there are now. */
export const views = computed(() => {
  // Who is nobody has nothing to see but the pairing.
  const nobody = me.value?.role === "nobody";
  return VIEWS.filter((view) => (nobody ? view.id === "access" : (view.when?.() ?? true)));
});

const hash = signal(location.hash);
addEventListener("hashchange", () => (hash.value = location.hash));

/** The one that is shown: the address's, else the first. */
export const view = computed<View>(() => {
  const id = hash.value.replace(/^#\/?/, "");
  return views.value.find((each) => each.id === id) ?? (views.value[0] as View);
});
