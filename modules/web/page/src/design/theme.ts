// Light or dark: as the device says, or as the switch does.
import { effect, signal } from "@preact/signals";

export type Theme = "auto" | "light" | "dark";
const KEY = "advee-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
const devices = signal(dark.matches);
dark.addEventListener("change", () => (devices.value = dark.matches));

export const theme = signal<Theme>(stored());
/** What is shown. */
export const shownTheme = signal<"light" | "dark">("light");

effect(() => {
  const shown = theme.value === "auto" ? (devices.value ? "dark" : "light") : theme.value;
  document.documentElement.dataset.theme = shown;
  shownTheme.value = shown;
  try {
    localStorage.setItem(KEY, theme.value);
  } catch {
    // A browser that keeps nothing shows what the device says.
  }
});

function stored(): Theme {
  try {
    const was = localStorage.getItem(KEY);
    return was === "light" || was === "dark" ? was : "auto";
  } catch {
    return "auto";
  }
}
