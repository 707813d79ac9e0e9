// Pairing over HTTP: who we are, the code, the devices. The session's cookie is the browser's affair.
import { batch, signal } from "@preact/signals";
import type { Device, Invite, Me, Pair, Refused } from "../protocol";
import { me } from "../state";

/** One more with each pairing begun or ended: the sockets are then somebody else's. */
export const session = signal(0);

/** A code that came in the address (`#12345678`): it is asked only for a name. */
export const codeInAddress = signal<string | null>(null);

/** Takes a pairing code out of the address, so that it stays in no history and no screenshot. */
export function codeOf(address: Location): void {
  const take = () => {
    const code = code8(decodeURIComponent(address.hash.slice(1)));
    if (code === null) return;
    codeInAddress.value = code;
    history.replaceState(null, "", `${address.pathname}${address.search}#/access`);
    dispatchEvent(new HashChangeEvent("hashchange"));
  };
  take();
  addEventListener("hashchange", take);
}

/** Eight digits, blanks and hyphens ignored; null: it is no code. */
export function code8(text: string): string | null {
  const digits = text.replace(/[\s-]/g, "");
  return /^[0-9]{8}$/.test(digits) ? digits : null;
}

/** Asks who we are. Whether there was an answer. */
export async function learn(): Promise<boolean> {
  const answer = await get<Me>("/api/me");
  if (typeof answer === "string") return false;
  me.value = answer;
  return true;
}

/** Pairs; what is wrong, in words, or null. */
export async function pair(code: string, name: string): Promise<string | null> {
  const answer = await post<Me>("/api/pair", { code, name } satisfies Pair);
  if (typeof answer === "string") return answer;
  batch(() => {
    me.value = answer;
    session.value += 1;
  });
  return null;
}

export async function unpair(): Promise<string | null> {
  const answer = await post<unknown>("/api/unpair", {});
  await learn();
  session.value += 1;
  return typeof answer === "string" ? answer : null;
}

export const devices = (): Promise<Device[] | string> => get<Device[]>("/api/devices");
export async function forget(id: number): Promise<string | null> {
  const answer = await post<unknown>("/api/devices/forget", { id });
  return typeof answer === "string" ? answer : null;
}

/** A code for a further operator's device; in words why there is none. */
export const invite = (): Promise<Invite | string> => post<Invite>("/api/invite", {});

const get = <T>(path: string): Promise<T | string> => request<T>(path, {});
export const post = <T>(path: string, body: object): Promise<T | string> =>
  request<T>(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });

/** The answer, or in words why there is none. */
async function request<T>(path: string, init: RequestInit): Promise<T | string> {
  try {
    const response = await fetch(path, { ...init, cache: "no-store" });
    const text = await response.text();
    if (response.ok) return (text ? JSON.parse(text) : {}) as T;
    return reason(text) || `the robot answered ${response.status}`;
  } catch {
    return "there is no connection to the robot";
  }
}

function reason(text: string): string {
  try {
    const why = (JSON.parse(text) as Partial<Refused>).why;
    return typeof why === "string" ? why : "";
  } catch {
    return "";
  }
}
