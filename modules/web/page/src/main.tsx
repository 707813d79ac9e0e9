import { render } from "preact";
import { App } from "./app";
import { start } from "./start";
import { ready } from "./words/language";
import "./design/tokens.css";
import "./design/base.css";
import "./ui/ui.css";
import "./shell/shell.css";

declare global {
  /** Set by the build: a page for development, with the fixture. */
  const DEV: boolean;
}

await Promise.all([start(), ready]);
render(<App />, document.body);
