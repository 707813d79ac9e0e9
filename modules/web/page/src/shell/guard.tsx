// A view that fails says so in its own place: the status, Stop and the other views go on.
import { Component, type ComponentChildren } from "preact";
import { Button, Card } from "../ui";
import { rich, t } from "../words";

export class Guard extends Component<{ children: ComponentChildren }, { why: string | null }> {
  override state = { why: null as string | null };

  override componentDidCatch(error: unknown): void {
    console.error(error);
    this.setState({ why: error instanceof Error ? error.message : String(error) });
  }

  override render() {
    if (this.state.why === null) return this.props.children;
    return (
      <Card title={t("This view failed")}>
        <p>{rich("It is a fault of this page, not of the robot: {why}", { why: <code>{this.state.why}</code> })}</p>
        <div class="row">
          <Button onClick={() => this.setState({ why: null })}>{t("Show it again")}</Button>
        </div>
      </Card>
    );
  }
}
