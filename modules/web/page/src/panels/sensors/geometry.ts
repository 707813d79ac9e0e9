// The robot's frame on a picture whose top is ahead: x forward goes up, y to the left goes left. All in m, rad.
import type { Plain } from "../../words";

export interface Place {
  x: number;
  y: number;
  theta: number;
}

const point = (x: number, y: number): string => `${(-y).toFixed(3)} ${(-x).toFixed(3)}`;

/** A point of the robot's frame, for SVG's x and y. */
export function onPicture(x: number, y: number): [number, number] {
  return [-y, -x];
}

/** What a ranger's beam covers up to `distance`, as an SVG path. */
export function beam(from: Place, distance: number, width: number): string {
  return `M${point(from.x, from.y)}L${edge(from, distance, -width / 2)}${arcTo(from, distance, width)}Z`;
}

/** The far end of a beam alone. */
export function front(from: Place, distance: number, width: number): string {
  return `M${edge(from, distance, -width / 2)}${arcTo(from, distance, width)}`;
}

function edge(from: Place, distance: number, angle: number): string {
  return point(from.x + distance * Math.cos(from.theta + angle), from.y + distance * Math.sin(from.theta + angle));
}

function arcTo(from: Place, distance: number, width: number): string {
  // From right to left seen along the beam: counter-clockwise, as on the picture.
  const radius = distance.toFixed(3);
  return `A${radius} ${radius} 0 0 0 ${edge(from, distance, width / 2)}`;
}

/** Corners in the robot's frame as SVG points. */
export function polygon(corners: readonly (readonly [number, number])[]): string {
  return corners.map(([x, y]) => point(x, y).replace(" ", ",")).join(" ");
}

const SIDES = ["rear", "rear right", "right", "front right", "front", "front left", "left", "rear left", "rear"] as const satisfies Plain[];
export type Side = (typeof SIDES)[number];

/** Which side of the robot a direction of its frame is on, in words: a text of the page. */
export function side(theta: number): Side {
  const turn = Math.atan2(Math.sin(theta), Math.cos(theta));
  return SIDES[Math.round((turn + Math.PI) / (Math.PI / 4))] as Side;
}

/** Roll and pitch of a quaternion x, y, z, w, rad; null where it is none. Pitch is positive with the front down. */
export function tilt([x, y, z, w]: readonly (number | null)[]): [number, number] | null {
  if (x == null || y == null || z == null || w == null) return null;
  return [Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), Math.asin(Math.max(-1, Math.min(1, 2 * (w * y - z * x))))];
}
