// Why something cannot be asked of the robot from here, or be relied on.
import { connection, demo, may } from "../state";
import { t } from "../words";

/** Why we may not do what needs that role; null: we may. */
export function lacks(needs: "operator" | "engineer"): string | null {
  if (demo.value) return t("This is a recorded run: nothing can be commanded.");
  if (!may(needs)) return needs === "engineer" ? t("Only engineers may do this.") : t("Pair this device as an operator to do this.");
  if (connection.value.state !== "live") return t("There is no connection to the robot.");
  return null;
}

/** The connection is lost: what is shown was true once. */
export const lost = (): boolean => connection.value.state === "lost";
